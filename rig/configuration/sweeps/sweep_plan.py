"""A sweep as its file describes it: the distributions drawn for each case, and the filter."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from control import ControlSettings, Quantity, Sequence
from faults import Criterion, OwnFigure, TestLimit
from rig.configuration.campaigns import plain
from rig.configuration.rigs import UNLESS_USUAL, Rig
from rig.plant import Model

from .distributions import Distribution

SweepFilter = Literal["thesis-7", "product"]
MotionType = Literal[
    "constant", "sine", "triangle", "trapezoid", "chirp", "multisine", "steps", "pseudorandom",
    "segments",
]  # fmt: skip

HEALTHY: Final = "healthy"
LATENCY: Final = "latency"
"""Name of the figure that only sweeps have: time in s from a leak's onset until it is named."""


@dataclass(frozen=True)
class SweptMotion:
    """One of the motions of a sweep; each case has one of them.

    Attributes:
        name: name in the table of cases, which is the type if the file gives none.
        type: type of setpoint, as in `control.setpoints`, or `segments`.
        share: weight by which cases get this motion, relative to the sum of all shares.
        quantity: `position` (m, closed loop) or `command` (V, open loop).
        values: key of the file -> its distributions: one for each element of `levels` and
            `frequencies`, and a single one for any other key.
        control: what the position loop adds to gain times error in this motion; None for the
            sweep's settings.
        sequence: the setpoint of a motion of type `segments`, the same in all its cases; None for
            other motions.
        criteria: what figures of its cases must be, those of the sweep first.
        limits: limits that its cases should keep, those of the sweep first.
    """

    name: str
    type: MotionType
    share: float
    quantity: Quantity
    values: Mapping[str, tuple[Distribution, ...]]
    control: ControlSettings | None = field(default=None, metadata=UNLESS_USUAL)
    sequence: Sequence | None = field(default=None, metadata=UNLESS_USUAL)
    criteria: tuple[Criterion, ...] = field(default=(), metadata=UNLESS_USUAL)
    limits: tuple[TestLimit, ...] = field(default=(), metadata=UNLESS_USUAL)

    @property
    def drawn(self) -> Mapping[str, Distribution]:
        """The quantities that differ from case to case, by their names in the table of cases."""
        return {
            f"{self.name}_{key}" + (f"_{index + 1}" if len(laws) > 1 else ""): law
            for key, laws in self.values.items()
            for index, law in enumerate(laws)
            if law.is_drawn
        }


@dataclass(frozen=True)
class SweptLevel:
    """One level of a leak that changes with time, with what is drawn for each case.

    Attributes:
        at: distribution of the time in s from which on the leak grows or shrinks to this level.
        ramp: distribution of the time in s that this takes; 0 for at once.
        size: distribution of the flow or the coefficient, as `SweptLeaks.size`.
    """

    at: Distribution
    ramp: Distribution
    size: Distribution


@dataclass(frozen=True)
class AdaptiveSizes:
    """How the sizes of leaks are drawn near the size of which a share is found.

    Attributes:
        found: the share of leaks that are named right at the size that is looked for.
        interval: a place is done once the upper end of the size's 95 % interval is at most this
            part above the lower end; 0 if the sweep runs all its cases.
        batch: number of cases whose sizes follow from the results of all cases before them.
    """

    found: float
    interval: float
    batch: int


@dataclass(frozen=True)
class SweptLeaks:
    """The leaks of a sweep's cases.

    Attributes:
        healthy: fraction of all cases that have no leak.
        places: kinds of leak, which are equally likely.
        size: distribution of the flow in m^3/s at `pressure`, or of the coefficient in
            m^3/(s Pa^0.5).
        pressure: for each place, the drop in Pa at which the flow is stated; None where sizes are
            coefficients.
        onset: distribution of the time in s at which the leak begins.
        profile: the levels of a leak that changes with time, in their order; empty for a leak that
            has its size from its onset on. `size` is that of the last level, and `onset` the time
            of the first.
        adaptive: how sizes are drawn near the one of which a share is found; None if all are drawn
            from `size`.
    """

    healthy: float
    places: tuple[str, ...]
    size: Distribution
    pressure: tuple[float, ...] | None
    onset: Distribution
    profile: tuple[SweptLevel, ...] = field(default=(), metadata=UNLESS_USUAL)
    adaptive: AdaptiveSizes | None = field(default=None, metadata=UNLESS_USUAL)


@dataclass(frozen=True)
class Sweep:
    """A sweep, ready to be run.

    Attributes:
        path: path of its file.
        rig: the rig that every case starts from.
        model: the model that filter and detector assume.
        filter_name: name of the filter that judges.
        false_alarms_per_day: rate of false alarms that the detector aims at.
        duration_s: duration of a case.
        longest_step_s: longest step in s of the plant's integration (`rig.plant.integrator`).
        cases: number of cases; with `leaks.adaptive`, the greatest number.
        seed: seed from which all cases are drawn.
        parameters: field of `rig.plant.parameters` -> the distribution that it is drawn from.
        followers: field -> another field to which it keeps its proportion.
        noise: distribution of the factor on the standard deviation of every transducer.
        leaks: the leaks of the cases; None if all cases are healthy.
        motions: the motions of the cases.
        source_files: path -> SHA-256 of every file that was read.
        control: what the position loop adds to gain times error; a motion may have settings of its
            own.
        own_figures: figures and quantities that the sweep's file defines by expressions.
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
    control: ControlSettings = field(default_factory=ControlSettings)
    own_figures: tuple[OwnFigure, ...] = ()

    def control_of(self, motion: SweptMotion) -> ControlSettings:
        """Return the control settings of a motion; those of an open-loop one add nothing."""
        if motion.quantity != "position":
            return ControlSettings()
        return self.control if motion.control is None else motion.control

    def gain_of(self, motion: SweptMotion) -> float:
        """Return the gain of the position loop in a motion, V/m, unless it is drawn for a case."""
        return self.control_of(motion).gain or self.rig.gain_V_per_m

    @property
    def meaning(self) -> Any:
        """Everything that the results depend on, as a mapping of plain values in SI.

        A sweep can be resumed only if this mapping has not changed.
        """
        rig = self.rig
        # A sweep without such settings means what it meant before there were any.
        chosen: dict[str, Any] = {}
        if self.control != ControlSettings():
            chosen["control"] = self.control
        if self.own_figures:
            chosen["figures"] = self.own_figures
        if rig.calibrations:
            chosen["calibrations"] = rig.calibrations
        return plain(
            {
                "name": self.name,
                "plant": rig.plant.parameters,
                "sensors": rig.sensors,
                "measured": [rig.has_spool_sensor, rig.has_supply_pressure_sensor],
                "position_gain": rig.gain_V_per_m,
                "command_limit": rig.limits.command_V,
                "model": self.model.parameters,
                "filter": self.filter_name,
                "false_alarms_per_day": self.false_alarms_per_day,
                "duration_s": self.duration_s,
                "longest_step_s": self.longest_step_s,
                "cases": self.cases,
                "seed": self.seed,
                "parameters": self.parameters,
                "followers": self.followers,
                "noise": self.noise,
                "leaks": self.leaks,
                "motions": self.motions,
                **chosen,
            }
        )

    @property
    def adaptive(self) -> AdaptiveSizes | None:
        """How sizes of leaks are drawn near the one of which a share is found; None if not so."""
        return None if self.leaks is None else self.leaks.adaptive

    @property
    def ticks(self) -> int:
        """Number of samples of a case at 1 kHz, those at its start and its end included."""
        return round(self.duration_s * 1000.0) + 1

    @property
    def rig_s(self) -> float:
        """Simulated seconds of all cases together."""
        return self.cases * self.duration_s
