"""Runs campaigns: each test runs in the loop, is recorded and judged, and its results are written.

The files are complete up to the point that the run reached, also after a crash or an abort.
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
