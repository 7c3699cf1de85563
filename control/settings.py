"""The keys by which a rig or a test chooses what the position loop adds to gain times error."""

from dataclasses import dataclass
from typing import Annotated, Literal

from rig.plant import Quantity as _Quantity


def _q(unit: str, lower: float, upper: float) -> _Quantity:
    return _Quantity(unit, lower, upper, "", "")


@dataclass(frozen=True)
class ControlSettings:
    """What the position loop adds to gain times error; by default nothing, as in the thesis.

    Attributes:
        gain: gain of the position loop; the rig's `position_gain` if not given.
        feedforward: `model` adds the command by which the detector's model follows the setpoint's
            velocity, friction and a spring load included; `none` adds none.
        feedforward_gain: the same from a constant gain instead, command by velocity.
        lead: how much earlier the feedforward comes; if not given, the lag of the valve and half a
            tick.
        null: command at which the valve is closed.
        deadband: command on either side of null at which the valve begins to open.
        deadband_width: command about null over which the deadband's compensation is smooth; the
            deadband itself if not given, with which the slope at null is at most doubled.
        integral_time: what the ram is behind its expected position is integrated with this time
            constant; no integral part if not given.
        integral_limit: greatest integral part of the command, of either sign; the default is just
            above what the largest null bias of a model asks for.
        hold_band: error within which the integral is held while the setpoint rests; if not given,
            a count of the encoder and half the jump of a ram that breaks away.
        cyclic: whether amplitude and phase of the setpoint's frequencies (sine, multisine) are
            corrected until the ram follows them.
        cyclic_time: time constant of that correction; two periods of a frequency at least.
        cyclic_limit: greatest correction of a frequency's amplitude; if not given, what the gain
            makes a quarter of the greatest command of, so that a rig whose speed for a volt is a
            third off can still be moved by three quarters of it.
    """

    gain: Annotated[float | None, _q("V/m", 0.1, 1e4)] = None
    feedforward: Literal["none", "model"] = "none"
    feedforward_gain: Annotated[float | None, _q("V s/m", 0.0, 1e3)] = None
    lead: Annotated[float | None, _q("s", 0.0, 0.1)] = None
    null: Annotated[float, _q("V", -2.0, 2.0)] = 0.0
    deadband: Annotated[float, _q("V", 0.0, 2.0)] = 0.0
    deadband_width: Annotated[float | None, _q("V", 1e-3, 5.0)] = None
    integral_time: Annotated[float | None, _q("s", 0.01, 100.0)] = None
    integral_limit: Annotated[float, _q("V", 0.0, 10.0)] = 2.0
    hold_band: Annotated[float | None, _q("m", 0.0, 0.01)] = None
    cyclic: bool = False
    cyclic_time: Annotated[float, _q("s", 0.5, 1e3)] = 4.0
    cyclic_limit: Annotated[float | None, _q("m", 0.0, 0.1)] = None

    @property
    def is_proportional(self) -> bool:
        """Return whether nothing is added to the proportional loop."""
        adds = self.null, self.deadband, self.feedforward_gain or 0.0
        return (
            not any(adds)
            and self.feedforward == "none"
            and self.integral_time is None
            and not self.cyclic
        )
