"""Computes which return blockages can be seen at all, and how many of these the detector names.

`python -m tools.studies.blockages --seed 1 --count 100` draws blockages of the return line of 2e12
to 3e13 Pa/(m^3/s)^2 as `tools.studies.confusion` does, on rigs whose supply pressure is measured,
and prints the bound and the verdicts of the default detector. A trial takes about 3 s of a
processor.

**The bound.** Let somebody know everything but whether the line is blocked: the place, the onset
and the size k of the blockage. In units of the expected noise the accounts are

    m = F n + g + k s + e,      n ~ N(0, I),      e ~ N(0, I)

with the nuisances F, the blockage's signature s from its onset on, and an error g of the model by
which the healthy rig may look like a blockage of up to the dead zone b of its flow. If g is that
error, health is likeliest to be mistaken, and the two hypotheses differ by the mean
(k - b / size) s of a normal vector with covariance I + F F'. By Neyman and Pearson's lemma no test
at a probability alpha of a false alarm has a greater power than the one of their likelihood ratio,
which is

    power = Phi(d - z),    d^2 = (k - b / size)^2 s' (I + F F')^-1 s,    Phi(z) = 1 - alpha

with alpha the stated rate times the length of the test. The null may shift where the blockage
begins (`NULL_SHIFT`), as in the detector, which is one more nuisance. A blockage counts as one that
can be seen if its power is 95 % or more. A detector that does not know k and the onset, and has to
hold the rate after each block, cannot reach the bound.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import sqrt
from multiprocessing import get_context
from statistics import NormalDist
from typing import Final

import numpy as np

from estimator.accounts import BLOCK_TICKS, Regression
from estimator.leaks import LeakTest, OilAccountDetector, filter_recording, samples_of
from estimator.leaks.replaying import part_of, stretch
from rig.plant import FAULTS, Model
from tools.counted_shares import counted
from tools.pages.marked_tables import markdown
from tools.studies.confusion import BLOCKAGES, ONSETS_S, SECONDS
from tools.studies.leak_trials import Plan, record

RATE: Final = 1.0
"""Stated false alarms in a day."""
SEEN_FROM: Final = 0.95
"""Power from which on a blockage counts as one that can be seen."""
_FAULT: Final = "return_blockage"


@dataclass(frozen=True)
class Outcome:
    """What became of one blockage.

    Attributes:
        size: coefficient, Pa/(m^3/s)^2.
        power: greatest probability with which any test could find it.
        verdict: the detector's last verdict.
        alarmed: names of all faults that the detector named at any time.
    """

    size: float
    power: float
    verdict: str
    alarmed: tuple[str, ...]

    @property
    def can_be_seen(self) -> bool:
        """Return whether the best of all tests would find it nearly always."""
        return self.power >= SEEN_FROM


def plan_of(seed: int, number: int) -> Plan:
    """Return what is recorded in a trial, which follows from seed and number alone."""
    rng = np.random.default_rng([seed, number, 7])
    size = float(np.exp(rng.uniform(*np.log(BLOCKAGES))))
    onset_s = float(np.round(rng.uniform(*ONSETS_S), 3))
    spool = bool(rng.random() < 0.5)
    return Plan(1_000_000 * seed + number, _FAULT, size, onset_s, SECONDS, spool, True)


def greatest_power(test: LeakTest, size: float, onset_s: float, alpha: float) -> float:
    """Return the bound on the power, 0 to 1, with which a blockage can be found.

    Args:
        test: a test that has been given all blocks of the recording.
        size: the blockage's coefficient, Pa/(m^3/s)^2.
        onset_s: when it began, s.
        alpha: probability of a false alarm within the recording.
    """
    sums, fault = test.sums, FAULTS.index(_FAULT)
    mark = sums.mark_at(onset_s)
    if mark >= sums.marks:
        return 0.0
    products = sums.faults_since()
    ff, fy, yy = sums.nuisances()
    scores = Regression(ff, fy, yy, 2 * sums.blocks, 1.0).score(products.crossed, products, 1.0)
    shown = float(products.sizes[mark, fault])
    dead = test.dead_zone[fault] / shown if shown > 0.0 else np.inf
    distance = max(size - dead, 0.0) * sqrt(float(scores.information[mark, fault]))
    normal = NormalDist()
    return normal.cdf(distance - normal.inv_cdf(1.0 - alpha))


def judged(seed: int, number: int) -> Outcome:
    """Record a trial, judge it block by block, and compute its bound from the same blocks."""
    plan = plan_of(seed, number)
    recording, _, _ = record(plan)
    run, detector = filter_recording(recording, Model()), OilAccountDetector(Model(), RATE)
    samples, bound = samples_of(recording), LeakTest(RATE)
    alarmed, verdict = set(), ""
    for start in range(0, samples.time_s.size, BLOCK_TICKS):
        part = slice(start + 1 if start else 0, start + BLOCK_TICKS + 1)
        piece = stretch(samples, part)
        if not piece.time_s.size:
            break
        detector.update(piece, part_of(run, part))
        for block in detector.drawn_up:
            bound.add(block)
        decision = detector.decide()
        verdict = decision.verdict
        if decision.names_a_fault:
            alarmed.add(verdict)
    alpha = RATE * plan.seconds / 86400.0
    power = greatest_power(bound, plan.size, plan.onset_s, alpha)
    return Outcome(plan.size, power, verdict, tuple(sorted(alarmed)))


def table(found: Sequence[Outcome]) -> str:
    """Return a table of those that can be seen by the bound, those that cannot, and of all."""
    head = ("by the bound", "blockages", "named at the end", "named at any time",
            "another fault was named at any time", "other verdicts at the end")  # fmt: skip
    groups = (
        (f"power of {SEEN_FROM:.0%} or more", [each for each in found if each.can_be_seen]),
        ("less", [each for each in found if not each.can_be_seen]),
        ("all", list(found)),
    )
    rows = []
    for name, of in groups:
        others = Counter(each.verdict for each in of if each.verdict != _FAULT)
        rows.append([
            name,
            str(len(of)),
            counted(each.verdict == _FAULT for each in of),
            counted(_FAULT in each.alarmed for each in of),
            str(sum(bool(set(each.alarmed) - {_FAULT}) for each in of)),
            ", ".join(f"{verdict} {count}" for verdict, count in others.most_common()),
        ])  # fmt: skip
    return markdown(head, rows)


def main(arguments: list[str] | None = None) -> None:
    """Judge the blockages and print the table; `arguments` None means those of the program."""
    parser = argparse.ArgumentParser(prog="python -m tools.studies.blockages",
                                     description=__doc__)  # fmt: skip
    parser.add_argument("--seed", type=int, required=True, help="draws all trials")
    parser.add_argument("--count", type=int, default=100, help="blockages; default 100")
    parser.add_argument("--jobs", type=int, default=1, help="processes; default 1")
    options = parser.parse_args(arguments)
    seeds, numbers = [options.seed] * options.count, range(options.count)
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        found = list(pool.map(judged, seeds, numbers))
    for number, each in enumerate(found):
        if each.can_be_seen and each.verdict != _FAULT:
            print(f"{number}: {each}")
    print(table(found))


if __name__ == "__main__":
    main()
