"""The sequential test for leaks that come and go, at a stated rate of false alarms.

A leak that opens for a second or two leaves little to a test for leaks that stay. Here each
opening adds to the evidence, which is kept while the leak is shut. docs/detection.md has the
derivation of the limit, and rates that were measured.
"""

from dataclasses import dataclass
from math import inf, log, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    BLOCK_S,
    NUISANCE_COUNT,
    UNINFORMED,
    AccountBlock,
    NuisanceBelief,
    dead_zones,
    least_variance,
    nuisance_index,
    reference_drop,
    whitening,
)
from rig.plant import FAULTS, LEAKS, LITRE_PER_MINUTE, Parameters

from .company import LEAST_OPENINGS, company
from .explanations import follow, shared_gain
from .kept_blocks import KeptBlocks
from .openings import Openings, duty_of, openings_in
from .records import Company, Episode, Intermittent

Array = NDArray[np.float64]

SHARE: Final = 0.1
"""Part of the stated rate of false alarms that this test may use.

The test for leaks that stay leaves it: it comes to 0.8 of the stated rate at most
(`DIRECTIONS` of `estimator.leaks.leak_statistic` is 2, where simulations give up to 1.6)."""
LEAST_CLAIMED: Final = 3
"""Fewest openings with which a leak is said to come and go: it came back twice."""
WITNESSES: Final = 4
"""Fewest blocks by which the limit can be reached: one block gives a quarter of it at most."""
RIVAL: Final = 10.0
"""Logarithm of the odds by which another cause must be less likely (as `RIVAL_GAIN`)."""
TEMPERING: Final = 0.67
"""Factor on all gains in log likelihood, for noise that lasts from block to block.

An autocorrelation of 0.2 raises the variance of a mean by (1 + 0.2) / (1 - 0.2) = 1.5."""
FORGETTING_BLOCKS: Final = 240.0
"""Blocks (two minutes) after which noise counts for 1/e in the estimate of its variance."""
MOST_EPISODES: Final = 200
"""Greatest number of openings that are listed."""
LOOKED_EVERY: Final = 4
"""Blocks (2 s) after which the openings are computed anew, if the leak did not open or shut before
(computing them takes 1.2 ms with two minutes of blocks)."""
_SETTLED_S: Final = 60.0
"""Time after its end from which on a listed opening is not changed any more, s."""
MINIMUM_BLOCKS: Final = 16
"""Blocks (8 s) by which the nuisances are known well enough for a leak to begin: their 32 values
outnumber the nuisances (as in `leak_statistic`)."""
_LONGEST_S: Final = 2.0 * BLOCK_S
"""Longest block that is looked at, s. Longer ones grew while a chamber was dry; what its cavity
takes and gives back comes and goes with the motion, as a leak may."""
_FLOWS: Final = (0.035, 0.09, 0.22, 0.55, 1.4)
"""Flows in L/min at the reference drop with which explanations begin, a factor of 2.5 apart."""
_NULL_BIAS: Final = nuisance_index("spool_null_bias")
_SHIFT: Final = len(FAULTS)
_RIVALS: Final = (
    *(((FAULTS.index(leak)), (0.05, 0.3)) for leak in LEAKS),
    (FAULTS.index("supply_leakage"), (1e5, 5e5)),
    (FAULTS.index("return_blockage"), (5e11, 3e12)),
    (_SHIFT, (0.05, 0.3)),
)
"""Other causes with the sizes that they begin with, of either sign.

They are leaks in L/min, a loss of supply pressure in Pa, a back-pressure of the return in
Pa/(m^3/s)^2, and a shift of the spool's null in units of its tolerance (0.5 and 3 um)."""
_MORE: Final = 1.25
"""Factor by which the openings must have become more before it is looked anew what they go with."""


@dataclass(frozen=True)
class _Dropped:
    """What is known of openings whose blocks were dropped."""

    episodes: tuple[Episode, ...] = ()
    openings: int = 0
    watched_s: float = 0.0
    open_s: float = 0.0


class ReturnTest:
    """Tests the blocks added so far for a leak that comes and goes.

    Time for a block and memory do not grow with the number of blocks.

    Args:
        parameters: the parameters of the rig that are assumed.
        false_alarms_per_day: the stated rate, of which this test uses `SHARE`.
        expected: mean and covariance of the nuisances before any block.
        model_error: factor on what is allowed for errors of the model, as in `LeakTest`.
    """

    def __init__(
        self,
        parameters: Parameters,
        false_alarms_per_day: float,
        expected: NuisanceBelief = UNINFORMED,
        model_error: float = 1.0,
    ) -> None:
        self._model_error = model_error
        self._expected = expected
        self._root = np.linalg.cholesky(expected.covariance)
        self.limit = -log(SHARE * false_alarms_per_day * BLOCK_S / 86400.0)
        self._least = least_variance(model_error)
        allowed = min(model_error, 1.0)
        tempering = 1.0 - allowed * (1.0 - TEMPERING)
        self._setting = self._least, self.limit / WITNESSES, tempering
        self._levels = _levels(parameters, model_error)
        count = len(self._levels)
        self._covariance = np.eye(NUISANCE_COUNT) / self._least
        self._mean = np.zeros(NUISANCE_COUNT)
        self._sums = np.array([8.0, 0.0, 0.0, 1.0 - 1.0 / FORGETTING_BLOCKS])
        self._weights = np.zeros((count, 3))
        self._means = np.zeros((count, 3, NUISANCE_COUNT))
        begins = self._levels[:, 1]
        self._sizes = np.column_stack([begins, 1.0 / (0.35 * begins) ** 2])
        self._squares = np.full(count, 8.0)
        self._blocks = KeptBlocks()
        self._added = 0
        self._dropped: dict[int, _Dropped] = {}
        self._claim: Intermittent | None = None
        self._looked: dict[int, tuple[int, Company | None]] = {}
        self._seen: tuple[int, int | None, int] | None = None

    def add(self, block: AccountBlock) -> None:
        """Add one block; one that is incomplete or longer than a second is ignored."""
        if not block.complete or block.end_s - block.start_s > _LONGEST_S:
            return
        if self._blocks.is_full:
            self._drop()
        white = whitening(block, self._model_error)
        nuisances = white @ block.nuisances
        missing = white @ block.missing - nuisances @ self._expected.mean
        shift = block.nuisances[:, _NULL_BIAS]
        shapes = white @ np.column_stack([block.faults, shift])
        rooted = np.ascontiguousarray(nuisances @ self._root)
        sizes = np.append(np.maximum(block.sizes, 1e-300), 1.0)
        unit = np.ascontiguousarray(shapes * (LITRE_PER_MINUTE / sizes))
        self._blocks.add(block, missing, rooted, shapes[:, : len(LEAKS)])
        gain, c = shared_gain(rooted, self._covariance)
        self._added += 1
        levels = self._levels if self._added > MINIMUM_BLOCKS else self._levels[:0]
        follow(
            (missing, rooted, np.ascontiguousarray(shapes), unit),
            gain, c, (self._mean, self._sums), self._setting, levels,
            self._weights, self._means, self._sizes, self._squares,
        )  # fmt: skip

    def evidence(self) -> tuple[Array, float, float]:
        """Return the logarithms of the statistics after the last block.

        Returns:
            That of each of `LEAKS`, float64 (3,); that of a change that stays; and that of any
            other cause that comes and goes.
        """
        totals = self._weights.sum(axis=1)
        leaks = np.array([totals[part].mean() for part in _LEAK_PARTS])
        stays, returns = totals[_STAYING].mean(), totals[_RETURNING].mean()
        least = 1e-300
        return (
            np.log(np.maximum(leaks, least)),
            log(max(float(stays), least)),
            log(max(float(returns), least)),
        )

    @property
    def stands_out(self) -> bool:
        """Return whether a leak that comes and goes explains the accounts beyond the limit.

        `search` claims it if it has had enough openings as well.
        """
        return self._leak() is not None

    def _leak(self) -> int | None:
        leaks, stays, returns = self.evidence()
        best = int(np.argmax(leaks))
        others = max(float(np.delete(leaks, best).max()), returns) + RIVAL
        if leaks[best] > max(self.limit + max(stays, 0.0), others):
            return best
        return None

    def search(self) -> Intermittent | None:
        """Return the leak that comes and goes; None if none is claimed.

        It is that of the last block, or of one at most `LOOKED_EVERY` blocks ago since when the
        leak neither opened nor shut. What was claimed once is not withdrawn, as a leak that stays
        away is still one that came and went.
        """
        leak = self._leak()
        if leak is None and self._claim is not None:
            leak = LEAKS.index(self._claim.leak)
        if leak is None:
            return None
        state = int(np.argmax(self._weights[self._leading(leak)]))
        before = self._seen
        if before is None or before[1:] != (leak, state) or self._added >= before[0] + LOOKED_EVERY:
            self._seen = self._added, leak, state
            self._claim = self._found(leak) or self._claim
        return self._claim

    def _found(self, leak: int) -> Intermittent | None:
        """Return what the blocks tell of a leak; None if it has not had `LEAST_CLAIMED` openings.

        Args:
            leak: index into `LEAKS`.
        """
        openings = self._openings(leak)
        dropped = self._dropped.get(leak, _Dropped())
        episodes = self._settled(LEAKS[leak], dropped.episodes + openings.episodes)
        count = dropped.openings + len(openings.episodes)
        if count < LEAST_CLAIMED or not openings.coefficient > 0.0:
            return None
        watched_s, open_s = self._times(openings, -inf if dropped.openings else episodes[0].start_s)
        watched_s, open_s = watched_s + dropped.watched_s, open_s + dropped.open_s
        now_s = float(self._blocks.end_s[-1])
        duty, interval = duty_of(episodes, watched_s, open_s, now_s)
        flow = openings.coefficient * openings.size
        evidence = float(self.evidence()[0][leak])
        return Intermittent(
            LEAKS[leak], evidence, self.limit, evidence - log(self._added),
            episodes[-MOST_EPISODES:], count, duty, interval,
            flow, openings.deviation * openings.size, openings.coefficient,
            self._goes_with(leak, openings, count),
        )  # fmt: skip

    def _settled(self, leak: str, episodes: tuple[Episode, ...]) -> tuple[Episode, ...]:
        """Return openings as they were listed before, if they ended `_SETTLED_S` ago or longer."""
        if self._claim is None or self._claim.leak != leak:
            return episodes
        settled_s = float(self._blocks.end_s[-1]) - _SETTLED_S
        known = {
            round(2.0 * each.start_s): each
            for each in self._claim.episodes
            if each.end_s is not None and each.end_s < settled_s
        }
        return tuple(known.get(round(2.0 * each.start_s), each) for each in episodes)

    def _leading(self, leak: int) -> int:
        """Return the row of a leak's explanation with the greatest weight."""
        part = _LEAK_PARTS[leak]
        return part.start + int(np.argmax(self._weights[part].sum(axis=1)))

    def _openings(self, leak: int) -> Openings:
        """Return when a leak was open; the search begins with its leading explanation."""
        at = self._leading(leak)
        shares = self._weights[at] / self._weights[at].sum()
        return openings_in(
            self._blocks, leak, float(self._sizes[at, 0]), shares @ self._means[at],
            self._least, self._model_error,
        )  # fmt: skip

    def _times(self, openings: Openings, since_s: float) -> tuple[float, float]:
        """Return for how long the kept blocks watch since `since_s`, and the leak was open, s."""
        start_s, end_s = self._blocks.start_s, self._blocks.end_s
        lengths = np.maximum(end_s - np.maximum(start_s, since_s), 0.0)
        whole = (end_s - start_s)[lengths > 0.0]
        return float(lengths.sum()), float((openings.open[lengths > 0.0] * whole).sum())

    def _goes_with(self, leak: int, openings: Openings, count: int) -> Company | None:
        """Return what the openings go with; it is looked anew when they have become more."""
        looked, found = self._looked.get(leak, (0, None))
        if count >= max(LEAST_OPENINGS, _MORE * looked):
            blocks = self._blocks
            found = company(
                openings.episodes, blocks.start_s, blocks.end_s, openings.open, blocks.motion()
            )
            self._looked[leak] = count, found
        return found

    def _drop(self) -> None:
        """Drop the older half of the blocks; keep what the openings in it were."""
        leak, blocks = self._leak(), self._blocks
        if leak is not None:
            openings = self._openings(leak)
            cut_s = float(blocks.end_s[blocks.count // 2 - 1])
            before = self._dropped.get(leak, _Dropped())
            gone = tuple(e for e in openings.episodes if e.end_s is not None and e.end_s <= cut_s)
            first_s = openings.episodes[0].start_s if openings.episodes else inf
            since_s = -inf if before.openings else first_s
            older = (blocks.end_s <= cut_s) & (blocks.end_s > since_s)
            lengths = blocks.end_s - blocks.start_s
            self._dropped[leak] = _Dropped(
                (before.episodes + gone)[-MOST_EPISODES:],
                before.openings + len(gone),
                before.watched_s + float(lengths[older].sum()),
                before.open_s + float((openings.open * lengths)[older].sum()),
            )
        blocks.drop_older_half()


_LEAK_PARTS: Final = [
    slice(leak * len(_FLOWS), (leak + 1) * len(_FLOWS)) for leak in range(len(LEAKS))
]
"""Rows of the explanations of each leak; after them come the other causes: those that stay, then
those that come and go."""
_OTHER: Final = 2 * sum(len(sizes) for _, sizes in _RIVALS)
_STAYING: Final = slice(len(LEAKS) * len(_FLOWS), len(LEAKS) * len(_FLOWS) + _OTHER)
_RETURNING: Final = slice(_STAYING.stop, None)


def _levels(parameters: Parameters, model_error: float) -> Array:
    """Return the rows of all explanations, as `follow` takes them: float64 (h, 4)."""
    units = [LITRE_PER_MINUTE / sqrt(reference_drop(parameters, leak)) for leak in LEAKS]
    dead = dead_zones(model_error)
    rows = [
        [leak, flow * unit, dead[leak], 0.0] for leak, unit in enumerate(units) for flow in _FLOWS
    ]
    others = []
    for of, sizes in _RIVALS:
        unit = units[of] if of < len(LEAKS) else 1.0
        zone = dead[of] if of < len(LEAKS) else 0.0
        others += [[of, sign * size * unit, zone] for size in sizes for sign in (1.0, -1.0)]
    # A leak of the own sign that comes and goes is no other cause.
    returning = [each for each in others if each[0] >= len(LEAKS) or each[1] < 0.0]
    rows += [[*each, 1.0] for each in others]
    rows += [[*each, 0.0] for each in returning]
    return np.array(rows)
