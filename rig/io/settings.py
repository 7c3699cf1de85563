"""Settings of a rig on hardware: how its loop is paced and watched, and how its encoder is homed.

Fields are the keys of the rig file's sections `loop` and `homing`; times in s, frequencies in Hz.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from rig.plant import Quantity as _Quantity

Overrun = Literal["skip", "realign", "trip"]


def _q(unit: str, lower: float, upper: float, source: str) -> _Quantity:
    return _Quantity(unit, lower, upper, "", source)


@dataclass(frozen=True)
class LoopSettings:
    """How the loop is paced, and after how long a silence each part of the session trips.

    Attributes:
        rate: ticks a second; filters and recordings know 1 kHz only.
        cpu: processor that the loop is pinned to; without, the kernel chooses.
        priority: of SCHED_FIFO; 0 asks for none.
        overrun: what follows a missed tick: `skip` it and count, `realign` the ticks to now, or
            `trip` after `trip_after` of them in a row. Never a burst to catch up.
        trip_after: missed ticks in a row that trip, if `overrun` is `trip`.
        slower_device: whether a fast device slower than the loop is refused, or its values held
            from one sample to the next, with their age recorded.
        exchange_timeout: how long the loop waits for a reply; the tick goes on without it then.
        stale_limit: age of the newest sample of the fast device at which the loop trips.
        slow_stale_limit: age at which a slow channel's value counts as none.
        loop_silence: silence of the loop process after which the others trip.
        field_silence: silence of the field process after which the others trip.
        supervisor_silence: silence of the supervisor after which the others trip.
        recorder_silence: silence of the recorder after which the others trip.
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
    """How an incremental encoder finds its zero: the ram is driven gently onto an end stop.

    Attributes:
        end: the stop to drive to; the plant's stroke says where it is.
        command: magnitude of the valve command; its sign follows from `end`.
        standstill: the ram is at the stop once it stood still for so long.
        speed: below it, it counts as standing still.
        load_pressure: difference of the chamber pressures that it may not exceed on the way.
        timeout: without a stop after so long, homing has failed.
        before_run: whether a campaign homes a rig that is not homed; else it is refused.
    """

    end: Literal["retract", "extend"] = "retract"
    command: Annotated[float, _q("V", 0.01, 2.0, "")] = 0.5
    standstill: Annotated[float, _q("s", 0.05, 10.0, "")] = 0.5
    speed: Annotated[float, _q("m/s", 1e-5, 0.1, "")] = 1e-3
    load_pressure: Annotated[float, _q("Pa", 1e5, 1e8, "")] = 8e6
    timeout: Annotated[float, _q("s", 1.0, 600.0, "")] = 60.0
    before_run: bool = True
