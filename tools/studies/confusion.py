"""Computes how the default detector names and sizes faults drawn at random (confusion matrix).

`python -m tools.studies.confusion --runs 500 --jobs 2` injects 500 leaks of log-uniform size, 0.03
to 2 L/min, in all three places, and faults of the lines as well. Rig and motion are drawn anew for
each, and half of the rigs have no spool sensor. The tables are written into docs/detection.md. Each
trial is kept in runs/confusion, so that an interrupted study goes on where it stopped.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import FAULTS, LEAKS
from tools.pages.marked_tables import fill, markdown

from .leak_trials import Plan, Trial, trials

Array = NDArray[np.float64]

PAGE: Final = Path(__file__).parents[2] / "docs" / "detection.md"

SECONDS: Final = 40.0
ONSETS_S: Final = (12.0, 25.0)
SIZES: Final = (0.03, 2.0)
"""Smallest and largest leak, L/min at its reference drop; sizes are drawn log-uniformly."""
SUPPLY_SIZES: Final = (5.0, 40.0)
"""The same for supply leaks, L/min at supply pressure; their supplies droop by 1e12 to 3e12
Pa/(m^3/s)^2."""
BLOCKAGES: Final = (2e12, 3e13)
"""The same for blockages of the return line, Pa/(m^3/s)^2: 0.05 to 0.8 MPa at 10 L/min."""
BINS: Final = (0.0, 0.03, 0.06, 0.1, 0.3, 1.0, float("inf"))
"""Edges of the rows of the sizing table, L/min of true mean flow."""
VERDICTS: Final = ("healthy", *FAULTS, "multiple", "unknown_fault", "inconclusive")
_LINE_PART: Final = 5
"""For this many leaks, each fault of the lines has one run with a supply sensor and one without."""


def plans(runs: int) -> Iterator[Plan]:
    """Yield the plans of all trials: `runs` leaks, then faults of the lines, then healthy rigs.

    For every five leaks, each of the two faults of the lines has two plans, with and without a
    sensor of supply pressure. There are half as many healthy rigs as leaks.
    """
    for i in range(runs):
        yield _plan(i, LEAKS[i % 3], SIZES)
    for kind, (fault, sizes) in enumerate(
        (("supply_leakage", SUPPLY_SIZES), ("return_blockage", BLOCKAGES)), start=1
    ):
        for i in range(2 * (runs // _LINE_PART)):
            yield _plan(100_000 * kind + i, fault, sizes, supply_sensor=i % 2 == 0)
    for i in range(runs // 2):
        yield _plan(900_000 + i, None, (1.0, 1.0))


def _plan(
    seed: int, fault: str | None, sizes: tuple[float, float], *, supply_sensor: bool = True
) -> Plan:
    # The fault is drawn from a random stream of its own; rig and motion use the plain seed.
    rng = np.random.default_rng([seed, 1])
    size = float(np.exp(rng.uniform(*np.log(sizes))))
    onset_s = float(np.round(rng.uniform(*ONSETS_S), 3))
    spool_sensor = bool(rng.random() < 0.5)
    return Plan(seed, fault, size, onset_s, SECONDS, spool_sensor, supply_sensor)


def truth(trial: Trial) -> str:
    """Return the name of the row of the confusion matrix that a trial belongs to.

    It is the injected fault or "healthy"; for faults of the lines it also says whether the supply
    pressure was measured.
    """
    plan = trial.plan
    if plan.fault is None:
        return "healthy"
    if plan.fault in LEAKS:
        return plan.fault
    return f"{plan.fault}, supply pressure {'' if plan.supply_sensor else 'not '}measured"


def confusion(found: Sequence[Trial]) -> str:
    """Return the confusion matrix in Markdown: injected fault by row, final verdict by column.

    Each cell is the number of trials; 0 is left empty.
    """
    counts: dict[str, Counter[str]] = {}
    for each in found:
        counts.setdefault(truth(each), Counter())[each.judged["product"].verdict] += 1
    head = ["injected", "runs", *(verdict.replace("_", " ") for verdict in VERDICTS)]
    rows = [
        [name.replace("_", " "), str(row.total()), *(str(row[v]) or "" for v in VERDICTS)]
        for name, row in counts.items()
    ]
    return markdown(head, [[cell if cell != "0" else "" for cell in row] for row in rows])


def sizing(found: Sequence[Trial]) -> str:
    """Return a table of how leaks were named and sized, by bin of true flow and for all leaks.

    Named right is a leak that the last verdict names. Latency and errors are those of these leaks.
    """
    leaks = [each for each in found if each.plan.fault in LEAKS]
    head = ["true flow, L/min", "leaks", "named right", "other alarm", "latency, median / 95 %",
            "bias", "rms error", "relative", "true flow in 95 % interval"]  # fmt: skip
    rows = []
    for low, high in pairwise(BINS):
        name = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
        rows.append(_sizing_row(name, [t for t in leaks if low <= t.flow < high]))
    return markdown(head, [*rows, _sizing_row("all", leaks)])


def _sizing_row(name: str, leaks: Sequence[Trial]) -> list[str]:
    right = [t for t in leaks if t.judged["product"].verdict == t.plan.fault]
    others = sum(t not in right and t.judged["product"].alarm_s() is not None for t in leaks)
    counts = [name, str(len(leaks)), str(len(right)), str(others)]
    if not right:
        return [*counts, *["–"] * 5]
    latencies = np.array([_latency(t) for t in right])
    errors = np.array([(t.judged["product"].flow or 0.0) - t.flow for t in right])
    flows = np.array([t.flow for t in right])
    middle, late = np.percentile(latencies, [50, 95])
    rms = float(np.sqrt(np.mean(errors**2)))
    relative = float(np.sqrt(np.mean((errors / flows) ** 2)))
    return [
        *counts,
        f"{middle:.1f} / {late:.1f} s",
        f"{errors.mean():+.4f}",
        f"{rms:.4f}",
        f"{relative:.1%}",
        f"{sum(covered(t) for t in right)} of {len(right)}",
    ]


def _latency(trial: Trial) -> float:
    named_s = trial.judged["product"].first_s(trial.plan.fault or "")
    return (named_s or np.nan) - trial.plan.onset_s


def covered(trial: Trial) -> bool:
    """Return whether the 95 % interval of the estimate holds the true mean flow; False without one.

    The estimate is that of the judge "product".
    """
    judgement = trial.judged["product"]
    if judgement.flow is None or judgement.deviation is None:
        return False
    return abs(judgement.flow - trial.flow) <= 1.96 * judgement.deviation


def main(arguments: list[str] | None = None) -> None:
    """Run the trials that are not kept from before, and write the tables into the page.

    `arguments` are those of the command line; None means those of the program.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.studies.confusion", description=__doc__)
    parser.add_argument("--runs", type=int, default=500, help="leaks; default 500")
    parser.add_argument("--jobs", type=int, default=2, help="processes; default 2")
    parser.add_argument("--kept", type=Path, default=Path("runs/confusion"), metavar="DIR")
    parser.add_argument("--out", type=Path, default=PAGE, metavar="FILE")
    options = parser.parse_args(arguments)
    found = trials(list(plans(options.runs)), options.kept, options.jobs)
    fill(options.out, {"confusion": confusion(found), "sizing": sizing(found)})
    print(options.out)


if __name__ == "__main__":
    main()
