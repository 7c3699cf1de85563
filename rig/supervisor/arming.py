"""These functions arm and home a connected rig, so that tests can be run on it."""

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
"""Time in s within which pump, valves and ram must be in the state that was asked for."""
RESET_S: Final = 120.0
"""Time in s within which the operator must press reset."""
HOMING_PERIOD_S: Final = 0.02
WITHIN_LIMITS_M: Final = 0.02
"""Distance in m from the position limits to which the ram is moved before they are watched."""
_WATCHED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
"""Channels of a `HomingSample`, in the order of its fields."""


def bring(rig: ConnectedRig, wanted: Mapping[str, float], state: str, action: str) -> None:
    """Set slow outputs, and wait until their feedback shows the wanted values.

    Outputs that no driver has are ignored, and outputs without a feedback are not awaited.

    Args:
        rig: the rig.
        wanted: slow output -> value, SI.
        state: what is wrong if the feedback does not come within `SETTLE_S`, as a phrase for the
            error's message, such as "the bypass valves are not where they were sent".
        action: what the operator is to do then, as a phrase for the same message.

    Raises:
        TripError: the feedback does not come in time, or the rig tripped or was stopped.
    """
    rig.write(wanted)
    rig.wait(lambda: not rig.off(wanted), SETTLE_S, state, action)


def arm(rig: ConnectedRig, *, held: bool = True) -> None:
    """Load the pump, activate the valve drive, shut the bypasses, and have the valve enabled.

    It waits until the operator has pressed reset; if the valve is enabled already, or the device
    does not report that, it does not wait. Afterwards the loop holds the ram. The state is then
    ARMED for a rig that needs no homing, else NOT_HOMED.

    Args:
        rig: the rig.
        held: whether the position loop holds the ram; if not, the command stays 0 V, as it must
            while nobody knows the signs of valve and encoder.

    Raises:
        TripError: no sample comes, the emergency stop is open, the loop reports a cause that
            forbids motion, pump or valves do not follow, nobody pressed reset within `RESET_S`, a
            process does not answer, or the rig tripped or was stopped.
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
    is_homed = rig.configured.homing is None
    gain = rig.configured.gain_V_per_m if held else 0.0
    rig.switch_to(Drive.HOLD, gain=gain, reset_lamp=True, rearm=True, reset=True, homed=is_homed)
    if rig.latest("valve_enabled") == 0.0:
        rig.say("waiting for the reset button: press it on the rig")
    rig.wait(
        lambda: rig.latest("valve_enabled") != 0.0, RESET_S,
        "the reset button was not pressed", "release the emergency stop and press reset",
    )  # fmt: skip
    rig.handle(Event.RESET_PRESSED)


def home(rig: ConnectedRig) -> None:
    """Find the encoder's zero at a stroke end; then hold the ram within its position limits.

    The commands are those of `Homing` above the valve's null, the `null` of the rig's control.
    It sets the rig's `offset_m`, and its state becomes ARMED. A rig whose state is not NOT_HOMED is
    left as it is.

    Raises:
        TripError: no stroke end was found reliably, the rig file does not allow homing before a
            run, the ram stays at the stroke end, a process does not answer, or the rig tripped or
            was stopped.
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
    null_V = rig.configured.control.null  # noqa: N806
    command_V, phase = 0.0, Phase.DONE  # noqa: N806
    while True:
        rig.check()
        try:
            sample = HomingSample(time.monotonic(), *map(rig.latest, _WATCHED))
            command_V = homing.next_command(sample) + null_V  # noqa: N806
        except HomingError as error:
            rig.handle(Event.HOMING_FAILED)
            raise TripError(f"homing failed: {error}") from error
        if homing.offset_m is not None:
            break
        if homing.phase is not phase:
            phase = homing.phase
            setpoint = np.full(round(settings.timeout / TICK), command_V)
            rig.switch_to(Drive.TRACK, open_loop=True, setpoint=setpoint, limit=abs(command_V))
        time.sleep(HOMING_PERIOD_S)
    rig.offset_m = homing.offset_m
    _come_within_limits(rig)
    rig.switch_to(Drive.HOLD, homed=True)
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
    """Move a ram from its end stop into its position limits, and wait until it is there."""
    limits = rig.configured.limits
    inside = np.clip(
        rig.latest("position_m") + rig.offset_m,
        limits.position_min_m + WITHIN_LIMITS_M,
        limits.position_max_m - WITHIN_LIMITS_M,
    )
    rig.switch_to(Drive.TRACK, setpoint=np.full(round(SETTLE_S / TICK), inside))
    rig.wait(
        lambda: abs(rig.latest("position_m") - inside) < 0.5 * WITHIN_LIMITS_M, SETTLE_S,
        "the ram did not come off the end stop", "look at the valve and its supply",
    )  # fmt: skip
