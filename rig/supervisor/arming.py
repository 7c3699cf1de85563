"""From a connected rig to one that tests can be run on: armed, and homed."""

import time
from collections.abc import Mapping
from typing import Final

import numpy as np

from rig.io import DriveState
from rig.loop import Drive, Homing, HomingError, HomingSample, Phase, TripError, Word
from rig.plant import TICK

from .connected_rig import ANSWER_S, ConnectedRig
from .moves import preparing_moves
from .states import Event, State

SETTLE_S: Final = 20.0
"""How long pump, valves and ram may take to be where they were asked to be."""
RESET_S: Final = 120.0
"""How long the operator may take to press reset."""
HOMING_PERIOD_S: Final = 0.02
WITHIN_LIMITS_M: Final = 0.02
"""How far within its limits the ram is when they begin to be watched."""


def bring(rig: ConnectedRig, wanted: Mapping[str, float], state: str, action: str) -> None:
    """Set slow outputs, and wait until their feedback is there.

    Args:
        rig: the rig.
        wanted: values by output.
        state: what the error says if they are not there within `SETTLE_S`.
        action: what the error asks for then.

    Raises:
        TripError: they are not there in time, a trip or a stop.
    """
    rig.write(wanted)
    rig.wait(lambda: not rig.off(wanted), SETTLE_S, state, action)


def arm(rig: ConnectedRig) -> None:
    """Load the pump, shut the bypasses, and have the operator enable the valve.

    Nothing is loaded while the emergency stop is open.

    Raises:
        TripError: the emergency stop is open, something is not where it should be, nobody pressed
            reset, a trip or a stop.
    """
    rig.wait(
        lambda: np.isfinite(rig.latest("position_m")), ANSWER_S,
        "no sample came", "check the I/O device",
    )  # fmt: skip
    rig.handle(Event.ARM)
    wanted = {
        "pump_load": 1.0,
        "drive_target": float(DriveState.ACTIVE),
        **preparing_moves(rig.configured, ()),
    }
    bring(
        rig, wanted, "pump, valve drive or bypass valves are not where they were asked to be",
        "look at them, and at what they report",
    )  # fmt: skip
    rig.switch_to(
        rig.segment(
            Drive.HOLD, reset_lamp=True, rearm=True, reset=True, homed=rig.configured.homing is None
        )
    )
    if rig.latest("valve_enabled") == 0.0:
        rig.say("waiting for the reset button: press it on the rig")
    rig.wait(
        lambda: rig.latest("valve_enabled") != 0.0, RESET_S,
        "the reset button was not pressed", "release the emergency stop and press reset",
    )  # fmt: skip
    rig.handle(Event.RESET_PRESSED)


def home(rig: ConnectedRig) -> None:
    """Find the encoder's zero, unless it is known; leave the ram within its limits.

    Raises:
        TripError: no stroke end that can be trusted was found, a trip or a stop.
    """
    if rig.state is not State.NOT_HOMED:
        return
    settings = rig.configured.homing
    assert settings is not None
    if not settings.before_run:
        raise TripError("the rig is not homed; set `homing: {before_run: true}`")
    rig.handle(Event.HOME)
    rig.say(f"homing: {settings.end} at {settings.command:g} V")
    homing = Homing(settings, rig.model.parameters, rig.configured.sensors.position_resolution)
    command_V, phase = 0.0, Phase.DONE  # noqa: N806
    while True:
        rig.check()
        try:
            command_V = homing.next_command(_homing_sample(rig))  # noqa: N806
        except HomingError as error:
            rig.handle(Event.HOMING_FAILED)
            raise TripError(f"homing failed: {error}") from error
        if homing.offset_m is not None:
            break
        if homing.phase is not phase:
            phase = homing.phase
            ticks = round(settings.timeout / TICK)
            rig.switch_to(
                rig.segment(
                    Drive.TRACK,
                    open_loop=True,
                    setpoint=np.full(ticks, command_V),
                    limit=abs(command_V),
                )
            )
        time.sleep(HOMING_PERIOD_S)
    rig.offset_m = homing.offset_m
    _come_within_limits(rig)
    rig.switch_to(rig.segment(Drive.HOLD, homed=True))
    rig.wait(
        lambda: bool(rig.board.words[Word.HOMED]), ANSWER_S,
        "the loop did not take the encoder's zero", "look at the session's log",
    )  # fmt: skip
    rig.say(
        f"homed: the encoder's zero is at {1e3 * rig.offset_m:.2f} mm; the stop was found twice, "
        f"{1e3 * homing.apart_m:.2f} mm apart"
    )
    rig.handle(Event.HOMED)


def _come_within_limits(rig: ConnectedRig) -> None:
    """Move a ram off its stop, as gently as it came; the limits are trusted from then on."""
    limits = rig.configured.limits
    inside = np.clip(
        rig.latest("position_m") + rig.offset_m,
        limits.position_min_m + WITHIN_LIMITS_M,
        limits.position_max_m - WITHIN_LIMITS_M,
    )
    ticks = round(SETTLE_S / TICK)
    rig.switch_to(rig.segment(Drive.TRACK, setpoint=np.full(ticks, inside)))
    rig.wait(
        lambda: abs(rig.latest("position_m") - inside) < 0.5 * WITHIN_LIMITS_M, SETTLE_S,
        "the ram did not come off the end stop", "look at the valve and its supply",
    )  # fmt: skip


def _homing_sample(rig: ConnectedRig) -> HomingSample:
    return HomingSample(
        time.monotonic(),
        rig.latest("position_m"),
        rig.latest("pressure_1_Pa"),
        rig.latest("pressure_2_Pa"),
    )
