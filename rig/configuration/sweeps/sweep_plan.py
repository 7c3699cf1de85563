"""A sweep as its file describes it: what is drawn for each case, and what judges it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from control import Quantity
from rig.configuration.rigs import Rig
from rig.plant import Model

from .distributions import Distribution

SweepFilter = Literal["thesis-7", "product"]
MotionType = Literal["constant", "sine", "chirp", "multisine", "steps", "pseudorandom"]

HEALTHY: Final = "healthy"


@dataclass(frozen=True)
class SweptMotion:
    """One of the motions that cases have.

    Attributes:
        name: in the table; its type, unless the file gives another.
        type: as in `control.setpoints`.
        share: weight of this motion among the others in the number of cases.
        quantity: `position` in m, closed loop, or `command` in V, open loop.
        values: what is drawn for each case, by key; `levels` and `frequencies` are one for each
            element.
    """

    name: str
    type: MotionType
    share: float
    quantity: Quantity
    values: Mapping[str, tuple[Distribution, ...]]


@dataclass(frozen=True)
class SweptLeaks:
    """Leaks that cases have.

    Attributes:
        healthy: part of all cases that have no leak.
        places: bypasses, each as likely.
        size: flow in m^3/s at `pressure`, or a coefficient in m^3/(s Pa^0.5).
        pressure: drop in Pa at which each place passes that flow; None where sizes are
            coefficients.
        onset: s.
    """

    healthy: float
    places: tuple[str, ...]
    size: Distribution
    pressure: tuple[float, ...] | None
    onset: Distribution


@dataclass(frozen=True)
class Sweep:
    """A sweep, ready to be run.

    Attributes:
        path: of its file.
        rig: what every case starts from.
        model: what filter and detector assume.
        parameters: what is drawn of `rig.plant.parameters`, by field.
        longest_step_s: of the plant's integration (`rig.plant.integrator`), s.
        followers: fields that keep their proportion to another one, by field: the other one.
        noise: factor on the deviation of every transducer.
        source_files: SHA-256 of every file read, by path.
        meaning: all that the figures depend on, as plain values in SI; a sweep can be resumed only
            if this is the same.
    """

    name: str
    description: str
    path: Path
    rig: Rig
    model: Model
    filter_name: SweepFilter
    false_alarms_per_day: float
    duration_s: float
    longest_step_s: float
    cases: int
    seed: int
    parameters: Mapping[str, Distribution]
    followers: Mapping[str, str]
    noise: Distribution
    leaks: SweptLeaks | None
    motions: tuple[SweptMotion, ...]
    source_files: Mapping[str, str]
    meaning: Mapping[str, Any]

    @property
    def ticks(self) -> int:
        """Samples of a case."""
        return round(self.duration_s * 1000.0) + 1

    @property
    def rig_s(self) -> float:
        """Rig-seconds of all cases."""
        return self.cases * self.duration_s
