"""Settings of a rig on hardware: how its loop is paced and watched, and how its encoder is homed.

Fields are the keys of the rig file's sections `loop` and `homing`; times are in s, frequencies in
Hz.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from rig.plant import Quantity as _Quantity

Overrun = Literal["skip", "realign", "trip"]


def _q(unit: str, lower: float, upper: float, source: str) -> _Quantity:
    return _Quantity(unit, lower, upper, "", source)


@dataclass(frozen=True)
class LoopSettings:
    """How the loop is paced, and how long each part of a session may be silent before a trip.

    Attributes:
        rate: ticks in a second; filters and recordings support 1 kHz only.
        cpu: processor to which the loop is pinned; if it is not given, the kernel chooses.
        priority: real-time priority of the loop (SCHED_FIFO); 0 asks for none.
        overrun: what follows a missed tick: `skip` counts it and goes on at the next one, `realign`
            moves the time grid to the present, `trip` trips after `trip_after` missed ticks in a
            row. The loop never catches up in a burst.
        trip_after: number of missed ticks in a row that trip, if `overrun` is `trip`.
        slower_device: what to do with a fast device that is slower than the loop: `refuse` it, or
            `hold` its values from one sample to the next, with their age recorded.
        exchange_timeout: how long the loop waits for the device's reply; after that the tick goes
            on without it.
        stale_limit: age of the fast device's newest sample beyond which the loop trips.
        slow_stale_limit: age beyond which a slow channel's value is recorded as missing.
        loop_silence: silence of the loop process after which the other processes trip.
        field_silence: silence of the field process after which the other processes trip.
        supervisor_silence: silence of the supervisor after which the other processes trip.
        recorder_silence: silence of the recorder after which the other processes trip.
    """

    rate: Annotated[float, _q("Hz", 1.0, 10e3, "")] = 1000.0
    cpu: Annotated[int | None, _q("", 0, 1023, "")] = None
    priority: Annotated[int, _q("", 0, 99, "sched(7)")] = 80
    overrun: Overrun = "skip"
    trip_after: Annotated[int, _q("", 1, 10_000, "")] = 50
    slower_device: Literal["refuse", "hold"] = "refuse"
    exchange_timeout: Annotated[float, _q("s", 1e-4, 1.0, "")] = 5e-3
    stale_limit: Annotated[float, _q("s", 1e-3, 10.0, "")] = 0.1
    slow_stale_limit: Annotated[float, _q("s", 1e-2, 60.0, "")] = 1.0
    loop_silence: Annotated[float, _q("s", 1e-2, 60.0, "")] = 0.2
    field_silence: Annotated[float, _q("s", 1e-2, 60.0, "")] = 1.0
    supervisor_silence: Annotated[float, _q("s", 1e-2, 60.0, "")] = 1.0
    recorder_silence: Annotated[float, _q("s", 1e-1, 600.0, "")] = 5.0


@dataclass(frozen=True)
class HomingSettings:
    """How the zero of an incremental encoder is found: the ram is driven gently onto an end stop.

    Attributes:
        end: the stop to which the ram is driven; its position is that end of the plant's stroke.
        command: magnitude of the valve command; its sign follows from `end`.
        standstill: time for which the ram must stand still to count as being at the stop.
        speed: speed below which the ram counts as standing still.
        load_pressure: difference of the chamber pressures that is not exceeded on the way.
        timeout: time after which homing has failed if one of its phases has not ended.
        before_run: whether a campaign homes a rig that is not homed; if not, the campaign is
            refused.
    """

    end: Literal["retract", "extend"] = "retract"
    command: Annotated[float, _q("V", 0.01, 2.0, "")] = 0.5
    standstill: Annotated[float, _q("s", 0.05, 10.0, "")] = 0.5
    speed: Annotated[float, _q("m/s", 1e-5, 0.1, "")] = 1e-3
    load_pressure: Annotated[float, _q("Pa", 1e5, 1e8, "")] = 8e6
    timeout: Annotated[float, _q("s", 1.0, 600.0, "")] = 60.0
    before_run: bool = True
