"""Runs campaigns: every test through the loop, its recording, verdict and results on disk.

Everything it writes is complete as far as the run came, also after a crash or an abort.
"""

from .campaign_run import run_campaign
from .directory import DirectoryError
from .observer import Observer
from .outcome import CampaignOutcome, InjectedFault, Status, TestOutcome
from .stopping import StopFlag, stop_on_signals

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
