"""Draws leaks that grow within a test, on both simulators, and prints what is made of them.

`python -m tools.studies.growing_leaks --seed 1 --count 48` records 48 tests of 60 s. In each a leak
in one of the three places grows from nothing to 0.1 to 1 L/min, log-uniform, within 5 to 40 s, and
stays so. The rig of an even number is the independent one of `tools.hidden_effects`, and that of an
odd number is drawn as in docs/detection.md. The detector has the nominal model, no baseline and one
false alarm a day. All of a test follows from its seed and number. A test takes about 3 s of a
processor; `--jobs` sets the number of processes.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import sqrt
from multiprocessing import get_context
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion as ProductMotion
from rig.plant import FAULT_COLUMNS, LEAKS, LITRE_PER_MINUTE, Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from tools.counted_shares import counted
from tools.hidden_effects.motions import drawn
from tools.hidden_effects.recordings import COLUMNS, record
from tools.intermittent.trials import healthy_rig
from tools.pages.marked_tables import markdown
from tools.simulated.drawn_rigs import MIDDLE, drawn_motion, drawn_rig
from tools.simulated.recordings import SETTLE_TICKS, recorded

Array = NDArray[np.float64]

SECONDS: Final = 60.0
SIZES: Final = (0.1, 1.0)
"""Smallest and largest flow of the grown leak at its reference drop, L/min."""
RAMPS_S: Final = (5.0, 40.0)
ONSETS_S: Final = (10.0, 18.0)
_DRIVING: Final = (6.9e6, 6.9e6, 2.5e6)
"""Reference drops of `LEAKS`, Pa: half the pump's pressure, and what the seals' friction takes."""
_MOTIONS: Final = ("multisine", "pseudorandom", "steps", "sines")
_PLACES: Final = ("opening_leak_1", "opening_leak_2", "opening_leak_across")


@dataclass(frozen=True)
class Drawn:
    """A leak that is drawn: its place, size (L/min), onset (s) and duration of growth (s)."""

    leak: str
    size: float
    onset_s: float
    ramp_s: float

    @property
    def coefficient(self) -> float:
        """Return the coefficient of the grown leak, m^3/(s Pa^0.5)."""
        return self.size * LITRE_PER_MINUTE / sqrt(_DRIVING[LEAKS.index(self.leak)])


@dataclass(frozen=True)
class Outcome:
    """What became of one test.

    Attributes:
        leak: the leak that was drawn.
        independent: whether the rig was the independent one.
        verdict: the last verdict.
        named_s: time from the leak's beginning to the first right verdict, s; None if none was.
        wrong: the other faults that were named at any time.
        grows: whether the last decision says that the leak grows, or grew.
        ratio: coefficient found for the grown leak over the true one; None if `grows` is false.
        within_s: duration of growth that was found, s; None if `grows` is false.
    """

    leak: Drawn
    independent: bool
    verdict: str
    named_s: float | None
    wrong: tuple[str, ...]
    grows: bool
    ratio: float | None
    within_s: float | None


def leak_drawn(seed: int, number: int) -> Drawn:
    """Return the leak of a test."""
    rng = np.random.default_rng([seed, number, 1])
    size, ramp = (float(np.exp(rng.uniform(*np.log(each)))) for each in (SIZES, RAMPS_S))
    return Drawn(LEAKS[number // 2 % 3], size, float(rng.uniform(*ONSETS_S)), ramp)


def recording(seed: int, number: int) -> Recording:
    """Return the recording of a test."""
    leak, n = leak_drawn(seed, number), round(SECONDS / TICK)
    rng = np.random.default_rng([seed, number, 0])
    if number % 2 == 0:
        rig = healthy_rig(rng, other_forms=number // 6 % 2 == 1)
        motion = drawn(_MOTIONS[int(rng.integers(len(_MOTIONS)))], rng, n)
        place = {_PLACES[LEAKS.index(leak.leak)]: leak.coefficient}
        rig = rig._replace(opens_at=leak.onset_s, opens_over=leak.ramp_s, **place)
        made = record(rig, motion, rng)
        return Recording({name: made.table[:, i].copy() for i, name in enumerate(COLUMNS)})
    truth = drawn_rig(rng)
    setpoint, open_loop = drawn_motion(rng, n)
    faults = np.zeros((n, len(FAULT_COLUMNS)))
    grown = np.clip((np.arange(n) * TICK - leak.onset_s) / leak.ramp_s, 0.0, 1.0)
    faults[:, FAULT_COLUMNS.index(leak.leak)] = leak.coefficient * grown
    made_rig = simulated_rig(Model(parameters=truth), 1000 * seed + number)
    return recorded(made_rig, ProductMotion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS))


def judged(seed: int, number: int) -> Outcome:
    """Record a test, and judge it."""
    leak = leak_drawn(seed, number)
    result = replay(recording(seed, number), Model())
    named = [time_s for time_s, each in result.history if each.verdict == leak.leak]
    wrong = {d.verdict for _, d in result.history if d.names_a_fault and d.verdict != leak.leak}
    final = result.decision
    growth = final.growth if final.verdict == leak.leak else None
    ratio = None
    if growth is not None and final.coefficient and final.leak_m3_per_s:
        size = final.leak_m3_per_s / final.coefficient
        ratio = growth.now_m3_per_s / size / leak.coefficient
    return Outcome(
        leak, number % 2 == 0, final.verdict, named[0] - leak.onset_s if named else None,
        tuple(sorted(wrong)), growth is not None, ratio, None if growth is None else growth.seconds,
    )  # fmt: skip


def table(found: Sequence[Outcome]) -> str:
    """Return a table by place and rig: how many are named, when, and how they are sized."""
    head = ("leak", "rigs", "tests", "named at the end", "another fault was named at any time",
            "named after it began, median / longest", "said to grow", "size now, rms error",
            "duration, median of found / true")  # fmt: skip
    rows = []
    for leak in (*LEAKS, None):
        of = [each for each in found if leak in (None, each.leak.leak)]
        for independent in (False, True):
            here = [each for each in of if each.independent is independent]
            if here:
                name = "all" if leak is None else leak.replace("_", " ")
                rows.append([name, "independent" if independent else "drawn", *_cells(here)])
    return markdown(head, rows)


def _cells(found: Sequence[Outcome]) -> list[str]:
    right = [each for each in found if each.verdict == each.leak.leak]
    times = [each.named_s for each in right if each.named_s is not None]
    grow = [each for each in right if each.ratio is not None and each.within_s is not None]
    errors = [each.ratio - 1.0 for each in grow if each.ratio is not None]
    spans = [(each.within_s or 0.0) / each.leak.ramp_s for each in grow]
    return [
        str(len(found)),
        counted(each in right for each in found),
        str(sum(bool(each.wrong) for each in found)),
        f"{np.median(times):.1f} / {max(times):.1f} s" if times else "–",
        str(len(grow)),
        f"{np.sqrt(np.mean(np.square(errors))):.1%}" if errors else "–",
        f"{np.median(spans):.2f}" if spans else "–",
    ]


def main(arguments: list[str] | None = None) -> None:
    """Judge the tests and print the table; `arguments` None means those of the program."""
    parser = argparse.ArgumentParser(prog="python -m tools.studies.growing_leaks",
                                     description=__doc__)  # fmt: skip
    parser.add_argument("--seed", type=int, required=True, help="draws all tests")
    parser.add_argument("--count", type=int, default=48, help="tests; default 48")
    parser.add_argument("--jobs", type=int, default=1, help="processes; default 1")
    options = parser.parse_args(arguments)
    seeds, numbers = [options.seed] * options.count, range(options.count)
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        found = list(pool.map(judged, seeds, numbers))
    for number, each in enumerate(found):
        if each.verdict != each.leak.leak or each.wrong:
            print(f"{number}: {each}")
    print(table(found))


if __name__ == "__main__":
    main()
