"""A campaign of tests as data: what each test does to the rig, and the verdict it should find."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf

from control import ControlSettings, Setpoint
from estimator.baselines import Baseline, baseline_doubt
from estimator.leaks import Detector, detector_for
from rig.plant import Model

from .criteria import Criterion, OwnFigure, TestLimit
from .schedule import Fault
from .verdict import Verdict


class OnFault(StrEnum):
    """What a test wants the loop to do when the detector has confirmed a fault."""

    IGNORE = "ignore"
    """The fault is only recorded."""
    TOLERATE = "tolerate"
    """The position loop compensates for confirmed leaks."""
    HOLD = "hold"
    """The ram is held where it is until the end of the test."""
    TRIP = "trip"
    """The rig trips."""


class WhenUnmet(StrEnum):
    """What happens to the running test when its campaign is held."""

    FINISH = "finish"
    """The test is run to its end before the campaign is held."""
    INTERRUPT = "interrupt"
    """The test is ended at once, with the ram held in place, and is run again later."""


@dataclass(frozen=True)
class Condition:
    """Limits of a channel within which a campaign may run, in the channel's SI unit.

    Attributes:
        channel: name of a signal that the rig measures.
        low, high: limits; the campaign is held while the channel is below `low` or above `high`.
            An infinite limit is never passed.
        hysteresis: distance inside the limits that the channel must reach for the campaign to go
            on.
        for_s: time in s for which the channel must be beyond its limits before the campaign is
            held, and back within them before it goes on.
        action: what happens to the running test.
        give_up_s: time in s after which a held campaign is stopped.
    """

    channel: str
    low: float = -inf
    high: float = inf
    hysteresis: float = 0.0
    for_s: float = 1.0
    action: WhenUnmet = WhenUnmet.FINISH
    give_up_s: float = 3600.0


@dataclass(frozen=True)
class Until:
    """What ends a test before its longest duration, which is the test's `duration_s`.

    Attributes:
        channel: name of a channel that the rig measures; empty if a verdict is awaited.
        low, high: range within which the channel must be, in its SI unit.
        verdict: the awaited verdict; None if a channel is awaited.
        for_s: time in s for which the channel must be within, or the verdict stand.
    """

    channel: str = ""
    low: float = -inf
    high: float = inf
    verdict: Verdict | None = None
    for_s: float = 0.0

    @property
    def label(self) -> str:
        """What is awaited, in words."""
        return f"until {self.verdict}" if self.verdict is not None else f"until {self.channel}"


@dataclass(frozen=True)
class SegmentEnd:
    """What ends a segment of a test before its longest duration; the next segment begins then.

    Times are those of the motion as it is laid out, in which every segment lasts its longest.

    Attributes:
        until: what is awaited; it counts from `begin_s` on.
        name: name of the segment, or its place such as "segment 3".
        begin_s: begin of the segment, s, after the blend that leads to it.
        end_s: its end at the latest, s, where the next segment begins.
        blend_s: time in s in which the ram is then brought to the next segment.
    """

    until: Until
    name: str
    begin_s: float
    end_s: float
    blend_s: float = 0.0

    @property
    def label(self) -> str:
        """What is awaited, and where, in words."""
        return f"{self.until.label} in {self.name}"


@dataclass(frozen=True)
class SpringLoad:
    """A spring that the ram runs against (section 7.1.1).

    Attributes:
        stiffness: stiffness in N/m.
        contact: position of the ram in m at which it touches the spring.
    """

    stiffness: float
    contact: float


@dataclass(frozen=True)
class LeakTestStep:
    """What a test asks that locks the cylinder and measures its leaks, in place of a motion.

    Attributes:
        at_most_m3_per_s: what the upper end of the 95 % interval of each place's leak may be at
            most, m^3/s; infinite for no limit.
        could_see_m3_per_s: the leak that the test must have been able to see in each place, as 95
            of 100 tests do, m^3/s; infinite if that does not matter.
        judges_verdict: whether the verdict must be the expected one for the test to pass.
    """

    at_most_m3_per_s: float = inf
    could_see_m3_per_s: float = inf
    judges_verdict: bool = True


@dataclass(frozen=True)
class ControlFrom:
    """Another control of a running test.

    Attributes:
        at_s: time from which it holds, s of the test.
        control: what the position loop adds to gain times error then; without a gain, the gain is
            that with which the test begins.
    """

    at_s: float
    control: ControlSettings


@dataclass(frozen=True)
class CampaignTest:
    """One test of a campaign, after matrices and repeats have been expanded; SI units.

    Before the first recorded sample, from which times count, the position loop takes `settle_s`:
    it moves the ram to `start_position_m` in the first three quarters and lets it rest there.
    Repeats of a test have the same `test_name`; they differ in `name`, `repeat` (counted from 1)
    and `seed`, and if their setpoint is drawn with that seed, in setpoint and start as well. `load`
    is None without a spring, and `expect` is the verdict that the test should find.
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
    gain_V_per_m: float | None = None  # noqa: N815
    """Gain of the position loop in this test, V/m; None for the rig's own."""
    own_figures: tuple[OwnFigure, ...] = ()
    """Figures and quantities that the campaign file defines for this test."""
    criteria: tuple[Criterion, ...] = ()
    """What figures must be for the test to pass, beside the verdict."""
    limits: tuple[TestLimit, ...] = ()
    """Limits that hold while the test runs, beside those of the rig."""
    wait_for: tuple[Condition, ...] = ()
    """What must hold of the rig before the test begins; `give_up_s` is the longest wait."""
    until: Until | None = None
    """What ends the test; if it has not come after `duration_s`, the test fails."""
    control: ControlSettings | None = field(default=None, metadata={"unless_usual": True})
    """What the position loop adds to gain times error in this test; None for the rig's settings."""
    segment_ends: tuple[SegmentEnd, ...] = field(default=(), metadata={"unless_usual": True})
    """What ends segments of the test early, in their order; what does not come fails the test."""
    control_changes: tuple[ControlFrom, ...] = field(default=(), metadata={"unless_usual": True})
    """Other control settings that hold from times of the test on, in the order of these times."""
    leak_test: LeakTestStep | None = field(default=None, metadata={"unless_usual": True})
    """What is asked of a test that locks the cylinder; its setpoint is where the ram then stands.
    None for a test that moves the ram."""


@dataclass(frozen=True)
class Campaign:
    """A list of tests on one rig, with the model and detector by which they are judged.

    Attributes:
        name: name of the campaign.
        description: text for people; may be empty.
        rig_name: name of the rig for which the tests were checked.
        model: model of the rig that the detector assumes.
        filter_name: `product`, `thesis-6` or `thesis-7`.
        false_alarms_per_day: alarms that the detector may raise on a healthy rig in a day.
        tests: the tests in the order in which they are run.
        baseline: what healthy recordings of the rig say is normal, which the detector allows for;
            None if it has the model only.
        baseline_file: path of the file from which the baseline was read; "" without one.
        source_files: SHA-256 of every file from which the campaign was read, by path.
        conditions: conditions of the rig; while one is not met, the campaign is held.
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
    conditions: tuple[Condition, ...] = ()

    def detector(self) -> Detector:
        """Return a new detector for the campaign's filter, with its model and any baseline."""
        if self.baseline is None:
            return detector_for(self.filter_name, self.model, self.false_alarms_per_day)
        return self.baseline.detector(self.filter_name, self.model, self.false_alarms_per_day)

    @property
    def baseline_doubt(self) -> str:
        """A sentence on what cannot be checked of the baseline's file; "" if all was checked."""
        if self.baseline is None:
            return ""
        return baseline_doubt(self.baseline_file, self.baseline)

    @property
    def rig_time_s(self) -> float:
        """Return the time in s that all tests take, settling included but not moves in between."""
        return sum(test.settle_s + test.duration_s for test in self.tests)
