"""Runs campaigns: every test through the loop, its recording, verdict and results on disk.

Everything it writes is complete as far as the run came, also after a crash or an abort.
"""

from rig.runner.campaign import StopFlag, run_campaign, stop_on_signals
from rig.runner.outcomes import CampaignOutcome, InjectedFault, Observer, Status, TestOutcome
from rig.runner.run_folder import DirectoryError

__all__ = [
    "CampaignOutcome",
    "DirectoryError",
    "InjectedFault",
    "Observer",
    "Status",
    "StopFlag",
    "TestOutcome",
    "run_campaign",
    "stop_on_signals",
]
