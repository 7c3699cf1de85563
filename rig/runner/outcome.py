"""What came of a campaign: one outcome a test, and the whole, as written to `results.json`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

from estimator.detection import Decision


class Status(StrEnum):
    """How a test ended."""

    PASSED = "passed"
    FAILED = "failed"
    ERROR = "error"
    ABORTED = "aborted"
    NOT_RUN = "not_run"


@dataclass(frozen=True)
class InjectedFault:
    """A fault as it was injected: what was asked of the rig, and the flow it really gave.

    Attributes:
        kind: one of the fault kinds.
        at_s, until_s: when it acted.
        coefficient: what was asked, SI (m^3/(s Pa^0.5), linear leaks m^3/(s Pa), return blockage
            Pa/(m^3/s)^2).
        linear: whether the coefficient is of the linear leak law.
        mean_flow_m3_per_s: mean absolute flow recorded from 2 s after onset to the end; None where the
            rig records none (supply and return line).
    """

    kind: str
    at_s: float
    until_s: float | None
    coefficient: float
    linear: bool
    mean_flow_m3_per_s: float | None


@dataclass(frozen=True)
class TestOutcome:
    """One test: what was expected, injected and found."""

    __test__ = False  # not a pytest class, whatever its name

    name: str
    expect: str
    status: Status
    seed: int
    duration_s: float
    injected: tuple[InjectedFault, ...] = ()
    decision: Decision | None = None
    detected_at_s: float | None = None
    recording: str | None = None
    """File name of the recording beside `results.json`."""
    message: str = ""
    wall_s: float = 0.0


EXIT_PASSED: Final = 0
EXIT_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_STOPPED: Final = 3


@dataclass(frozen=True)
class CampaignOutcome:
    """A campaign's outcomes with what is needed to run it again."""

    name: str
    description: str
    rig: str
    model: str
    filter: str
    false_alarms_per_day: float
    started: str
    tests: tuple[TestOutcome, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Versions, git state, hashes of every file read."""

    @property
    def exit_code(self) -> int:
        """0 all as expected, 1 a test failed or crashed, 3 stopped before the end."""
        statuses = {test.status for test in self.tests}
        if statuses & {Status.ABORTED, Status.NOT_RUN}:
            return EXIT_STOPPED
        if statuses & {Status.FAILED, Status.ERROR}:
            return EXIT_FAILED
        return EXIT_PASSED
