"""A campaign of tests as data: what each test does to the rig, and what should be found."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from control import Setpoint
from estimator.leaks import Baseline, Detector, detector_for
from rig.plant import Model

from .conditions import Condition
from .schedule import Fault
from .verdict import Verdict


class OnFault(StrEnum):
    """What a test asks to be done about a confirmed fault (docs/campaigns.md)."""

    IGNORE = "ignore"
    TOLERATE = "tolerate"
    HOLD = "hold"
    TRIP = "trip"


@dataclass(frozen=True)
class SpringLoad:
    """A spring the ram runs against: stiffness in N/m, contact position in m (section 7.1.1)."""

    stiffness: float
    contact: float


@dataclass(frozen=True)
class CampaignTest:
    """One test of a campaign, matrices and repeats written out; SI units.

    Times count from the first recorded sample; the position loop has then held `start_position_m`
    for `settle_s`. Repeats of a test share `test_name` and differ in `repeat`, counted from 1, and
    in `seed`.
    """

    name: str
    test_name: str
    duration_s: float
    start_position_m: float
    settle_s: float
    setpoint: Setpoint
    load: SpringLoad | None
    faults: tuple[Fault, ...]
    expect: Verdict
    repeat: int
    seed: int
    on_fault: OnFault = OnFault.IGNORE


@dataclass(frozen=True)
class Campaign:
    """A list of tests on one rig, and the model and detector they are judged by.

    Attributes:
        rig_name: the rig the tests were checked against.
        model: what the detector assumes of the rig.
        filter_name: `product`, `thesis-6` or `thesis-7`.
        baseline: what the detector may assume of the rig; None if it knows the model only.
        baseline_file: where the baseline was read from.
        source_files: SHA-256 of every file the campaign was read from, by path.
        resolved: the campaign with its rig and models as plain values, for the recordings.
        conditions: of the rig; while one does not hold, the campaign is held.
    """

    name: str
    description: str
    rig_name: str
    model: Model
    filter_name: str
    false_alarms_per_day: float
    tests: tuple[CampaignTest, ...]
    baseline: Baseline | None = None
    baseline_file: str = ""
    source_files: Mapping[str, str] = field(default_factory=dict)
    resolved: Mapping[str, Any] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()

    def detector(self) -> Detector:
        """Return a new detector with the campaign's model and baseline."""
        if self.baseline is None:
            return detector_for(self.filter_name, self.model, self.false_alarms_per_day)
        return self.baseline.detector(self.filter_name, self.model, self.false_alarms_per_day)

    @property
    def rig_time_s(self) -> float:
        """Return how long the rig is busy, settling included."""
        return sum(test.settle_s + test.duration_s for test in self.tests)
