"""Computes the limits of leak detection, and writes them into docs/detection.md and the README.

`python -m tools.detection_limits --runs 500 --jobs 2` simulates 500 leaking and 500 healthy rigs,
and 50 more for the check of the bound, and draws three figures. The trials of the first two are
kept, so that an interrupted study goes on where it stopped.
"""

import argparse
from pathlib import Path
from typing import Final

from rig.plant.integrator import TICK
from tools.pages.marked_tables import fill
from tools.studies.leak_trials import trials

from . import figures, tables
from .bound import Bound, budgeted_noise, exact_noise, flow_bound
from .courses import courses
from .errors import bound_beside, errors
from .study import ONSET_S, plans

ROOT: Final = Path(__file__).parents[2]
WINDOWS_S: Final = (1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 60.0)


def bounds() -> tuple[dict[str, Bound], dict[str, Bound]]:
    """Return the bounds by name of motion: if the model is exact, and with its budget of errors."""
    exact, budgeted = {}, {}
    for course in courses(round((ONSET_S + WINDOWS_S[-1]) / TICK) + 2):
        exact[course.name] = flow_bound(course, exact_noise(course), ONSET_S, WINDOWS_S)
        budgeted[course.name] = flow_bound(course, budgeted_noise(course), ONSET_S, WINDOWS_S)
    return exact, budgeted


def main(arguments: list[str] | None = None) -> None:
    """Compute the bounds, run the trials that are not kept, and write figures and tables.

    `arguments` are those of the command line; None means those of the program.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.detection_limits", description=__doc__)
    parser.add_argument("--runs", type=int, default=500, help="leaks; default 500")
    parser.add_argument("--jobs", type=int, default=2, help="processes; default 2")
    parser.add_argument("--kept", type=Path, default=Path("runs/detection_limits"), metavar="DIR")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", metavar="DIR",
                        help="with detection.md and images")  # fmt: skip
    parser.add_argument("--readme", type=Path, default=ROOT / "README.md", metavar="FILE")
    options = parser.parse_args(arguments)
    exact, budgeted = bounds()
    found = trials(list(plans(options.runs)), options.kept, options.jobs)
    leaks = [trial for trial in found if trial.plan.fault is not None]
    healthy = [trial for trial in found if trial.plan.fault is None]
    check, beside = errors(max(options.runs // 10, 6), options.jobs), bound_beside()
    images = options.out / "images"
    figures.limits(leaks, exact, budgeted, images / "detection_limits.png")
    figures.outcomes(healthy, leaks, images / "detection_outcomes.png")
    figures.error_check(check, beside, images / "detection_errors.png")
    fill(
        options.out / "detection.md",
        {
            "bounds": tables.bounds(exact, budgeted),
            "power": tables.power(healthy, leaks),
            "outcomes": tables.outcomes(leaks),
            "errors": tables.error_check(check, beside),
        },
    )
    fill(options.readme, {"smallest": tables.smallest(leaks, exact, budgeted)})
    print(options.out / "detection.md")


if __name__ == "__main__":
    main()
