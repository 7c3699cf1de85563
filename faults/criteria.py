"""What a test's figures must be, and the limits that its channels must keep, as data."""

from dataclasses import dataclass, field
from math import inf
from typing import Final, Literal

from .expressions import Expression

FOLLOWING_ERROR: Final = "following_error_m"
"""Name of the distance between setpoint and measured position, m; at least 0."""

MEASURES: Final = {
    "rms_error": "m",
    "peak_error": "m",
    "overshoot": "",
    "settling": "s",
    "peak": "",
    "valley": "",
    "leak": "m^3/s",
}
"""Figures that a criterion may ask for by name -> SI unit; peak and valley have their channel's."""

STEP_M: Final = 1e-3
"""Change of a setpoint within a tick, m, that counts as a step: 1 m/s, faster than the valve can
move the ram (0.71 m/s, section 2.1) and than any smooth setpoint that it can follow."""

WATCHED_FIGURES: Final = {
    "rms_error": "rms(setpoint_m - position_m)",
    "peak_error": "max(abs(setpoint_m - position_m))",
    "peak": "max({channel})",
    "valley": "min({channel})",
    "residual_pressure_1": "mean(abs(innovation_pressure_1_Pa))",
    "residual_pressure_2": "mean(abs(innovation_pressure_2_Pa))",
    "loop_wakeup_p50": "percentile(wakeup_s, 50)",
    "loop_wakeup_p99": "percentile(wakeup_s, 99)",
    "loop_command_p99": "percentile(sent_s, 99)",
    "loop_missed": "missing(wakeup_s)",
}
"""Figures that a limit may watch while a test runs -> the expression that they are, over the last
samples or over a stretch. Those of the loop are of channels that a simulated rig does not have."""
STEP_FIGURES: Final = ("overshoot", "settling")
"""Figures of the steps of a setpoint, which a limit judges for each step."""
FRICTION: Final = "friction_"
"""What the names of identified friction parameters begin with; they are known at a test's end."""
DECIDED_FIGURES: Final = {"leak": "m^3/s", "bulk_modulus": "Pa"}
"""Figures that a limit may watch, of which the detector's newest decision tells -> SI unit."""


@dataclass(frozen=True)
class OwnFigure:
    """A figure, or a quantity at each sample, that a campaign file defines by an expression.

    Attributes:
        name: its name.
        expression: how it is computed from the channels, in SI.
        unit: its SI unit; empty for a plain number.
    """

    name: str
    expression: Expression
    unit: str


@dataclass(frozen=True)
class Criterion:
    """Limits of a figure within which a test passes, in the figure's SI unit.

    Attributes:
        figure: name of the figure: one of `MEASURES`, of the test's own, or of those that every
            test has.
        low, high: least and greatest value with which the test passes; infinite for no limit.
        unit: SI unit of the figure.
        channel: channel of peak and valley; empty for other figures.
        during: name of the segment over which the figure is taken; empty for the whole test.
        from_s, until_s: the stretch over which it is taken, s of the test.
    """

    figure: str
    low: float
    high: float
    unit: str
    channel: str = ""
    during: str = ""
    from_s: float = 0.0
    until_s: float = inf

    @property
    def label(self) -> str:
        """The name under which the figure is kept: with its channel, and where it is taken."""
        of = f" of {self.channel}" if self.channel else ""
        where = f" in {self.during}" if self.during else ""
        if not self.during and (self.from_s > 0.0 or self.until_s < inf):
            end = "" if self.until_s == inf else f" to {self.until_s:g} s"
            where = f" from {self.from_s:g} s{end}"
        return f"{self.figure}{of}{where}"


LimitAction = Literal["warn", "hold", "ramp_down", "trip"]
LimitEach = Literal["step", "cycle", "segment", "test"]


@dataclass(frozen=True)
class LimitBand:
    """One of the two bands of a limit.

    Attributes:
        name: "inner" or "outer".
        low, high: ends of the band, SI; infinite for none.
        action: what is done beyond it.
    """

    name: str
    low: float
    high: float
    action: LimitAction


@dataclass(frozen=True)
class TestLimit:
    """A limit that holds while a test runs: an inner band, warned of, and an outer one, acted on.

    Attributes:
        watched: name of a channel, `FOLLOWING_ERROR`, or the name of a figure.
        unit: SI unit of what is watched.
        low, high: ends of the outer band, SI; infinite for none.
        inner_low, inner_high: ends of the inner band, SI; infinite for none.
        action: what is done beyond the outer band.
        for_s: time in s for which the value must be beyond a band.
        hysteresis: how far back within a band the value must come, SI, before it counts as within.
        over_s: for a figure, the time in s before now over which it is computed; else 0.
        during: name of the segment in which it holds; empty for the whole test.
        windows_s: the stretches (begin, end) of the motion as it is laid out, in s, in which it
            holds; empty for the whole test.
        each: for a figure that is computed once for each stretch of a kind, and judged when it is
            known: "step", "cycle", "segment" or "test"; empty for what is judged all the time.
    """

    __test__ = False  # not a pytest class, whatever its name

    watched: str
    unit: str
    low: float = -inf
    high: float = inf
    inner_low: float = -inf
    inner_high: float = inf
    action: LimitAction = "trip"
    for_s: float = 0.0
    hysteresis: float = 0.0
    over_s: float = 0.0
    during: str = field(default="", metadata={"unless_usual": True})
    windows_s: tuple[tuple[float, float], ...] = field(default=(), metadata={"unless_usual": True})

    expression: Expression | None = field(default=None, metadata={"unless_usual": True})
    """How a figure that is not the test's own follows from the channels; None for others."""
    each: LimitEach | Literal[""] = field(default="", metadata={"unless_usual": True})

    @property
    def bands(self) -> tuple[LimitBand, ...]:
        """The bands that the limit has, the inner one first."""
        bands = (
            LimitBand("inner", self.inner_low, self.inner_high, "warn"),
            LimitBand("outer", self.low, self.high, self.action),
        )
        return tuple(band for band in bands if (band.low, band.high) != (-inf, inf))
