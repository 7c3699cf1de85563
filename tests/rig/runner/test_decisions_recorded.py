"""What was decided while a test ran stands beside the samples that came after."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from estimator.filters.registry import FilterRun
from estimator.leaks.detection import Decision
from estimator.leaks.oil_account import Samples
from faults.campaign import Campaign, CampaignTest
from faults.verdict import Verdict
from rig.configuration.rigs.rig import Rig
from rig.loop.decided import DECIDED, VERDICT_CODES
from rig.recording import read_recording
from rig.runner import run_campaign

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class Counting:
    """A detector whose probability of health is the number of stretches it has seen."""

    def __init__(self) -> None:
        self.seen = 0

    def update(self, samples: Samples, run: FilterRun) -> None:
        self.seen += 1

    def decide(self) -> Decision:
        return Decision("internal_leakage", probabilities={"healthy": float(self.seen)})


def test_what_was_decided_after_a_block_stands_in_every_row_of_the_next(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(make_test(duration_s=1.7, expect=Verdict.INTERNAL_LEAKAGE))
    run_campaign(campaign, rig, tmp_path, detector=lambda model: Counting())
    recording = read_recording(tmp_path / "healthy.mcap")
    decided = {name: recording[name] for name in DECIDED}
    # Blocks end with the samples at 0.5, 1.0 and 1.5 s.
    for values in decided.values():
        assert np.isnan(values[:501]).all()
    assert decided["probability_healthy"][501:].tolist() == [1.0] * 500 + [2.0] * 500 + [3.0] * 199
    assert decided["decided_at_s"][501::500].tolist() == [0.5, 1.0, 1.5]
    assert recording.metadata["verdict_codes"][int(decided["verdict_code"][-1])] == VERDICT_CODES[3]
