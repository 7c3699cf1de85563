"""Learns a baseline from some recordings of a rig, and judges the others and leaks in them.

Leaks are added to the accounts of healthy recordings, in proportion to their signature: what a leak
of 0.03 L/min changes in pressures and motion, which the accounts hold anyway, is left out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from estimator.accounts.flow import AccountBlock
from estimator.baselines.learning import belief_of, learnt_noise
from estimator.leaks.finding import Finding
from estimator.leaks.leak_statistic import MINIMUM_BLOCKS, LeakTest
from estimator.leaks.learnt_test import LearntLeakTest
from estimator.learnt import regime_of
from rig.plant import LEAKS, LITRE_PER_MINUTE, Model
from tools.alarm_rates.hours import PIECE_S, PIECES, Piece, pieces

RATES: Final = (100.0, 10.0)
"""Alarms a day that the tests are set to."""
SIZES: Final = ((0.03, 10.0), (0.015, 60.0))
"""Sizes of the leaks, L/min of mean flow in the time in which they are to be named, and that time,
s."""
LEAK_RATE: Final = 10.0
"""Alarms a day that the tests are set to that look for leaks."""
_BEFORE: Final = 120
"""Healthy blocks (one minute) before each leak."""
_LONGEST: Final = 120
"""Blocks (one minute) for which an alarm stands at most before the test begins anew."""
_EVERY: Final = 2
"""The test is asked once in this many blocks, of half a second each."""
_IN_MOTION: Final = ("multisine", "pseudorandom", "steps", "sines", "ramps")
_PARAMETERS: Final = Model().parameters
Begin = Callable[[], LeakTest]


class Alarm(NamedTuple):
    """An alarm on a healthy rig: the setting, alarms a day, and the regime in which it came."""

    rate: float
    regime: str


class Sought(NamedTuple):
    """A leak that was looked for.

    Attributes:
        size: mean flow, L/min.
        leak: one of `LEAKS`.
        named: whether it was named in time, and nothing before it began.
        other: whether anything else was named first.
    """

    size: float
    leak: str
    named: bool
    other: bool


@dataclass(frozen=True)
class Judged:
    """What came of one rig.

    Attributes:
        seed: of the rig.
        seconds: time judged by regime, s.
        alarms: false alarms, as (rate, regime).
        leaks: leaks looked for, as the fields of `Sought`.
        expected: for each of `RATES`, the 90 % interval that each baseline stated.
    """

    seed: int
    seconds: dict[str, float]
    alarms: list[Alarm]
    leaks: list[Sought]
    expected: list[tuple[float, float, float]]


def judged_rig(
    seed: int, folder: Path, leaks: int = 2, piece_s: float = PIECE_S, count: int = PIECES
) -> Judged:
    """Judge each half of a rig's recordings with a baseline from the other half.

    Args:
        seed: of the rig.
        folder: where its accounts are kept.
        leaks: leaks of each place and size in each recording.
        piece_s: length of each recording, s.
        count: number of recordings.
    """
    made = pieces(seed, folder, count, piece_s)
    halves = made[: count // 2], made[count // 2 :]
    found = Judged(seed, {}, [], [], [])
    for number, (base, test) in enumerate((halves, halves[::-1])):
        begin = _Learnt([piece.blocks for piece in base])
        noise = begin.noise
        for rate in RATES:
            found.expected.append((rate, *noise.tail.interval(rate)))
        rng = np.random.default_rng([seed, 2, number])
        for piece in test:
            for block in piece.blocks:
                regime = regime_of(block, _PARAMETERS)
                length = block.end_s - block.start_s
                found.seconds[regime] = found.seconds.get(regime, 0.0) + length
            for rate in RATES:
                alarms = false_alarms(piece, partial(begin.test, rate))
                found.alarms.extend(Alarm(rate, regime_of(block, _PARAMETERS)) for block in alarms)
            for size, within_s in SIZES:
                found.leaks.extend(_sought(piece, begin, rng, leaks, size, within_s))
    return found


class _Learnt:
    """A baseline learnt from accounts, which begins tests."""

    def __init__(self, recordings: Sequence[Sequence[AccountBlock]]) -> None:
        noise = learnt_noise(recordings, _PARAMETERS)
        if noise is None:
            raise ValueError("the recordings are too short to learn from")
        self.noise = noise
        self._belief = belief_of(recordings, noise, _PARAMETERS)

    def test(self, rate: float) -> LeakTest:
        """Return a new test at a number of alarms a day."""
        return LearntLeakTest(rate, self._belief, self.noise, _PARAMETERS)


def false_alarms(piece: Piece, begin: Begin) -> Iterator[AccountBlock]:
    """Yield the block at which each alarm begins; when it has passed, the test begins anew.

    An alarm that stands for a minute counts as passed, and what goes on raises the next one.

    Args:
        piece: a healthy recording.
        begin: returns a new test.
    """
    test, standing = begin(), 0
    for number, block in enumerate(piece.blocks):
        test.add(block)
        if number % _EVERY:
            continue
        alarmed = test.blocks >= MINIMUM_BLOCKS and bool(test.search())
        if alarmed and not standing:
            yield block
        if standing and (not alarmed or standing >= _LONGEST):
            test, standing = begin(), 0
        elif alarmed:
            standing += _EVERY


def _sought(
    piece: Piece, begin: _Learnt, rng: Generator, count: int, size: float, within_s: float
) -> Iterator[Sought]:
    length = round(2.0 * within_s)
    moving = [kind in _IN_MOTION for kind in piece.kinds]
    onsets = [
        onset
        for onset in range(_BEFORE, len(piece.blocks) - length)
        if all(moving[onset - 20 : onset + length])
    ]
    for number, leak in enumerate(LEAKS if onsets else ()):
        for _ in range(count):
            onset = int(rng.choice(onsets))
            window = piece.blocks[onset : onset + length]
            mean = float(np.mean([block.sizes[number] for block in window]))
            coefficient = size * LITRE_PER_MINUTE / mean
            test = begin.test(LEAK_RATE)
            for block in piece.blocks[onset - _BEFORE : onset]:
                test.add(block)
            found = bool(test.search())
            named = False
            for at, block in enumerate(window, start=1):
                added = coefficient * block.faults[:, number]
                test.add(replace(block, missing=block.missing + added))
                if found or (at % _EVERY and at < length):
                    continue
                findings = test.search()
                if findings:
                    named = _only(findings, number)
                    found = True
            yield Sought(size, leak, named, found and not named)


def _only(findings: Sequence[Finding], fault: int) -> bool:
    return [finding.fault for finding in findings] == [fault]
