"""The detector by oil accounts with compiled arithmetic, for one rig in a lane."""

from collections.abc import Iterator
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    FAULT_COUNT,
    NUISANCE_COUNT,
    NUISANCES,
    AccountBlock,
    AccountSums,
    Scores,
    compile_ramp_search,
    nuisance_index,
)
from estimator.encoder import DriftTest
from estimator.leaks import (
    RIVAL_GAIN,
    Candidates,
    FaultSizes,
    Finding,
    LeakTest,
    OilAccountDetector,
    SupplyTest,
    least_gain,
)

from .candidates import CompiledCandidates, Scored, log_evidence, scored_blocks, standing_out
from .drifting import drift_scores
from .dropping import searched
from .sizing import sized
from .whitening import drift_row, whitened

Array = NDArray[np.float64]

_NULL_BIAS: Final = nuisance_index("spool_null_bias")


class CompiledSizes(FaultSizes):
    """Sizes of sudden faults by compiled code."""

    def _sudden(
        self, fault: int, mark: int, beside: Finding | None, dead_zone: float, variance: float
    ) -> Finding:
        found = self._sized(fault, mark, beside, dead_zone, variance)
        return super()._sudden(fault, mark, beside, dead_zone, variance) if found is None else found

    def _sized(
        self, fault: int, mark: int, beside: Finding | None, dead_zone: float, variance: float
    ) -> Finding | None:
        """Return the finding; None where compiled code cannot size the fault.

        That is so once blocks have lost their marks, after two minutes, or if the fault does not
        show apart from the other one.
        """
        sums = self.sums
        blocks = self.recent.kept
        if sums.marks != sums.blocks or blocks is None:
            return None
        other = (-1, 0) if beside is None else (beside.fault, sums.mark_of(beside.onset))
        sound, coefficient, deviation, statistic, lasting, began = sized(
            *sums.packed, blocks, fault, mark, *other, dead_zone, variance, self.model_error
        )
        if not sound:
            return None
        onset_s = sums.start_s(mark)
        if mark:
            onset_s -= began * sums.seconds(mark - 1, mark)
        onset = int(sums.mark_blocks[mark])
        return Finding(fault, onset, coefficient, deviation, statistic, 0.0, onset_s, lasting)


class CompiledLeakTest(LeakTest):
    """A leak test whose scores and sizes are computed by compiled code, without a baseline."""

    def __init__(self, *setting: Any) -> None:
        super().__init__(*setting)
        self._raw: dict[tuple[int, int] | None, Scored] = {}
        self._thresholds: dict[tuple[float, float], float] = {}

    def add(self, block: AccountBlock) -> None:
        """Add one block; an incomplete one is ignored."""
        self._raw = {}
        self._thresholds = {}
        super().add(block)

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        """Return the value that a healthy rig exceeds at the stated rate, as `LeakTest` does."""
        key = freedom, part
        if key not in self._thresholds:
            self._thresholds[key] = super().threshold(freedom, part)
        return self._thresholds[key]

    def _search(self) -> list[Finding]:
        # With no gain of `RIVAL_GAIN` no pair and no leak that grew are looked for either.
        raw = self._scored_blocks(None)
        if raw.most < min(RIVAL_GAIN, least_gain(raw.freedom, self.threshold(raw.freedom))):
            return self._slow()
        return super()._search()

    def best(self, beside: Finding | None = None) -> Finding | None:
        """Return the fault with the greatest gain whose statistic exceeds the limit; else None.

        As in `LeakTest`, of which little is needed where no gain is large enough.

        Args:
            beside: a fault that was found and is fitted along; None for the first fault.
        """
        raw = self._scored_blocks(beside)
        of = self.threshold if beside is None else self.limit_beside
        return None if raw.most < least_gain(raw.freedom, of(raw.freedom)) else super().best(beside)

    def log_evidence(self, lasting: float, greatest_flow: float) -> Array:
        """Return the logarithm of each fault's likelihood beside none, summed over onsets: (5,)."""
        raw = self._scored_blocks(None)
        found: Array = log_evidence(
            raw.scores, raw.sizes, raw.usable, self.dead_zone, lasting, greatest_flow
        )
        return found

    def _standing_out(
        self, beside: Finding | None, limit: float, dead_zone: Array
    ) -> tuple[Array, NDArray[np.int64]]:
        raw = self._scored_blocks(beside)
        most = max(raw.most, raw.changed)
        gain, marks = standing_out(
            raw.scores, raw.sizes, raw.usable, raw.gain, most, limit, dead_zone
        )
        return gain, marks

    def likely(self) -> Iterator[Finding]:
        """Yield each fault whose gain is `RIVAL_GAIN` or more, greatest gain first."""
        return super().likely() if self._scored_blocks(None).most >= RIVAL_GAIN else iter(())

    def null_bias(self) -> tuple[float, float]:
        """Return the spool's null bias less the model's, and its standard deviation, both in m."""
        sigma = NUISANCES[_NULL_BIAS].sigma
        if not self.blocks:
            return 0.0, sigma
        first = next(iter(self.search()), None)
        if first is not None and first.ramp is not None:
            return super().null_bias()
        mean, variance = self._scored_blocks(first).null_bias
        return sigma * mean, sigma * sqrt(variance)

    def _scored_blocks(self, beside: Finding | None) -> Scored:
        key = None if beside is None else (beside.fault, beside.onset)
        if key not in self._raw:
            self._raw[key] = scored_blocks(self.sums, self._least_variance, beside)
        return self._raw[key]

    def _in_noise(self, block: AccountBlock) -> tuple[Array, Array, Array]:
        white: tuple[Array, Array, Array] = whitened(
            block.missing, block.nuisances, block.faults, block.doubts, self.model_error
        )
        return white

    def _scores(self, beside: Finding | None) -> Candidates:
        if beside is not None and beside.ramp is not None:
            return super()._scores(beside)
        known = None if beside is None else (beside.fault, self.mark(beside))
        return CompiledCandidates(self._scored_blocks(beside), known)

    def _sizes(self) -> FaultSizes:
        products = self.candidates().products
        return CompiledSizes(self.sums, products, self._recent, self.model_error, self._sized)


class CompiledSupplyTest(SupplyTest):
    """A test of the supply pressure whose search for the likeliest drop is compiled."""

    def _likeliest_of(
        self, rows: Array, tried: range
    ) -> tuple[int, float, float, float, float] | None:
        fell, at, drop, deviation, statistic, spread = searched(
            rows, self._before, self._since, tried.start, tried.stop, self._blocks, self.settings
        )
        return (at, drop, deviation, statistic, spread) if fell else None


class CompiledDriftTest(DriftTest):
    """A test for a drift of the encoder whose blocks and scores are computed by compiled code."""

    def _row(self, block: AccountBlock) -> Array:
        moved, per_second = self._moved(block)
        row: Array = drift_row(
            block.missing, block.nuisances, block.faults, block.doubts, moved, per_second,
            self._model_error,
        )  # fmt: skip
        return row

    def _scores(self) -> tuple[Scores, Array, float]:
        return drift_scores(self._rows, self._starts, self._before, self._blocks, self.settings)


class CompiledDetector(OilAccountDetector):
    """The detector by oil accounts for leaks that stay, with compiled arithmetic."""

    leak_test = CompiledLeakTest
    supply_test = CompiledSupplyTest
    drift_test = CompiledDriftTest


def load_compiled() -> None:
    """Load or compile what `CompiledDetector` runs only once it finds a fault."""
    sums, zone = AccountSums(), np.ones(FAULT_COUNT)
    ones = np.ones((1, 2, NUISANCE_COUNT)), np.ones((1, 2, FAULT_COUNT + 1))
    sized(*sums.packed, (np.ones((1, 2)), *ones), 0, 0, -1, 0, 0.0, 1.0, 1.0)
    raw = scored_blocks(sums, 1.0, None)
    CompiledCandidates(raw, None).regression.nuisances()
    standing_out(raw.scores, raw.sizes, raw.usable, raw.gain, 0.0, 1.0, zone)
    log_evidence(raw.scores, raw.sizes, raw.usable, zone, 1.0, 1.0)
    compile_ramp_search()
