"""The page tells by how much a held-out gap varies by chance."""

from dataclasses import replace

from estimator.gap import ChannelGap, GapResult
from rig.report.gap.words import gap_words

CHANNEL = ChannelGap("position_m", 30.0, 15.5, 14.0, 1e-3, 1e-5, "m", ("um", 1e6), 0.9, 0.1, 0.1)


def words(scatter: float) -> str:
    result = GapResult("missing_effect", [], gap_before=16.0, gap_after=1.5)
    result.channels = [replace(CHANNEL, scatter=scatter), replace(CHANNEL, scatter=0.0)]
    return gap_words(result)


def test_a_gap_that_chance_moves_is_told_with_its_scatter() -> None:
    assert words(2.8).endswith("1.50 after (which varies by 1.40 by chance).")


def test_a_scatter_that_does_not_matter_is_not_told() -> None:
    assert words(0.01).endswith("1.50 after.")
