"""How far the ram of a closed-loop test will be from its setpoint, computed before it runs.

The rig is reduced to what decides that below the oil's resonance: a valve that lags, its null bias
and overlap, its limit, and a ram whose speed follows from the opening and from friction and spring
(`control.reduced_velocity`). The loop itself is the one that runs, uncompiled, so that nobody waits
for the compiler.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings, feedforward_command, frequencies_of, valve_lag
from faults import CampaignTest
from rig.configuration.rigs import Rig
from rig.plant import TICK, Model, Parameters

from .loop_of_test import control_of, gain_for, with_load

Array = NDArray[np.float64]

LONGEST_S: Final = 20.0
"""Time in s from a test's start that is computed: many times what a loop takes to settle."""
_NOTABLE: Final = 1.02
"""Volts that a motion needs, over the limit, from which this is told: what is short by less, for
the moment of the motion's greatest speed, is made up for at once."""
_JUMPS: Final = 2.0
"""Change of a setpoint within a tick, over the larger one of those in the ticks before and after
it, from which the setpoint jumps: a motion goes on for longer than a tick."""


@dataclass(frozen=True)
class Following:
    """How a test's ram is expected to follow its setpoint.

    Attributes:
        worst: greatest error, m.
        rms: root mean square of the error, m.
        needed_V: greatest command that the motion itself asks for, without its jumps, V.
        needed_at_s: when that is, s.
        law: the control law in words.
        limit_V: greatest command of the rig, V.
        tracks: whether the law adds anything to gain times error.
    """

    worst: float
    rms: float
    needed_V: float  # noqa: N815
    needed_at_s: float
    law: str
    limit_V: float  # noqa: N815
    tracks: bool

    @property
    def out_of_reach(self) -> str:
        """What a motion needs that the rig does not have, in words; "" if it has enough."""
        if self.needed_V <= _NOTABLE * self.limit_V:
            return ""
        return (
            f"the motion needs {self.needed_V:.3g} V at {self.needed_at_s:.2f} s against friction "
            f"and load, the limit is {self.limit_V:g} V"
        )

    def __str__(self) -> str:
        """Return the expected error as one line of text."""
        reach = f"; {self.out_of_reach}" if self.out_of_reach else ""
        rms = f"{1e3 * self.rms:.2g}" if self.rms < 0.0995 else f"{1e3 * self.rms:.0f}"
        return (
            f"following error at most {1e3 * self.worst:.3g} mm, {rms} mm rms, "
            f"expected with {self.law}{reach}"
        )


def expected_following(test: CampaignTest, rig: Rig, assumed: Model) -> Following:
    """Return how the ram of a closed-loop test is expected to follow, over its first `LONGEST_S`.

    The corrections of a cyclic setpoint, which take time to be learnt, are left out, and so are
    faults.

    Args:
        test: a test whose setpoint is a position.
        rig: the rig; its plant is taken for the truth.
        assumed: the model that the loop's feedforward assumes.
    """
    settings = control_of(rig, test)
    gain = gain_for(rig, test)
    setpoint, position = expected_motion(test, settings, gain, rig, assumed)
    error, true = setpoint - position, with_load(rig.plant, test).parameters
    whole = test.setpoint.sample(np.arange(round(test.duration_s / TICK)) * TICK)
    model_ahead = ControlSettings(feedforward="model", lead=0.0)
    needed = np.where(
        _smooth(whole), np.abs(feedforward_command(whole, model_ahead, true, inf)), 0.0
    )
    at = int(np.argmax(needed))
    return Following(
        worst=float(np.abs(error).max()),
        rms=float(np.sqrt(np.mean(error**2))),
        needed_V=float(needed[at]),
        needed_at_s=at * TICK,
        law=law_in_words(settings, gain, bool(frequencies_of(test.setpoint))),
        limit_V=rig.limits.command_V,
        tracks=not settings.is_proportional,
    )


def expected_motion(
    test: CampaignTest,
    settings: ControlSettings,
    gain: float,
    rig: Rig,
    assumed: Model,
    begin_s: float = 0.0,
    end_s: float = inf,
) -> tuple[Array, Array]:
    """Return setpoint and expected position (ticks,) of a closed-loop test under a control, m.

    The ram begins at rest at the setpoint. At most `LONGEST_S` are computed.

    Args:
        test: a test whose setpoint is a position.
        settings: the control settings; their gain is not looked at.
        gain: gain of the position loop, V/m.
        rig: the rig; its plant is taken for the truth.
        assumed: the model that the loop's feedforward assumes.
        begin_s: time of the test from which the motion is computed, s.
        end_s: time of the test up to which it is computed, s.
    """
    first = round(begin_s / TICK)
    last = round(min(test.duration_s, end_s, begin_s + LONGEST_S) / TICK)
    setpoint = test.setpoint.sample(np.arange(first, last) * TICK)
    true, believed = (with_load(model, test).parameters for model in (rig.plant, assumed))
    return setpoint, _followed(test, setpoint, settings, gain, rig, true, believed)


def _smooth(setpoint: Array) -> NDArray[np.bool_]:
    """Return for each tick whether the setpoint moves on to it and from it without a jump."""
    change = np.abs(np.diff(setpoint, prepend=setpoint[0], append=setpoint[-1]))
    around = np.maximum(np.append(change[1:], 0.0), np.append(0.0, change[:-1]))
    jumps = change > _JUMPS * around
    return ~(jumps[:-1] | jumps[1:])


def law_in_words(settings: ControlSettings, gain: float, cyclic: bool) -> str:
    """Return a control law as a list in words; `cyclic`: whether the setpoint repeats itself."""
    parts = [f"{gain:g} V/m"]
    if settings.feedforward == "model" or settings.feedforward_gain:
        parts.append("feedforward")
    if settings.null or settings.deadband:
        parts.append("null and deadband")
    if settings.integral_time is not None:
        parts.append(f"integral of {settings.integral_time:g} s")
    if len(parts) == 1 and not settings.cyclic:
        return f"{parts[0]} alone"
    learnt = ", before its frequencies are corrected" if settings.cyclic and cyclic else ""
    return ", ".join(parts) + learnt


def _followed(
    test: CampaignTest,
    setpoint: Array,
    settings: ControlSettings,
    gain: float,
    rig: Rig,
    par: Parameters,
    believed: Parameters,
) -> Array:
    """Return the position (ticks,) in m of the reduced rig under the loop of a test."""
    # The import is here so that checking other files need not load the compiler.
    from control import PLAIN, control_memory, guide_of, reduced_velocity, tracking_command

    limit = rig.limits.command_V
    guide = guide_of(
        test.setpoint, setpoint, settings, believed, rig.sensors, gain, limit, compiled=False
    )
    law, ahead = guide.law, guide.feedforward.tolist() or [0.0] * setpoint.size
    expected = (guide.expected if guide.expected.size else setpoint).tolist()
    command = getattr(tracking_command, "py_func", tracking_command)
    memory, lag = control_memory(), min(TICK / valve_lag(par), 1.0)
    proportional, no_tones = law.proportional, PLAIN.tones
    position = float(setpoint[0])
    sent = velocity = 0.0
    found = np.empty(setpoint.size)
    for k, wanted in enumerate(setpoint.tolist()):
        found[k] = position
        if proportional:
            asked = min(max(gain * (wanted - position), -limit), limit)
        else:
            asked = command(
                wanted, position, ahead[k], expected[k], k * TICK, gain, limit, TICK, law, no_tones,
                memory,
            )  # fmt: skip
        sent += lag * (asked - sent)
        velocity = reduced_velocity(sent, position, velocity, par)
        position += velocity * TICK
    return found
