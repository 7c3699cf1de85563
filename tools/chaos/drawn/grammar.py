"""The grammar: groups of faults, each with what is drawn of it, and how a case is drawn."""

import random
from collections.abc import Callable
from signal import SIGHUP, SIGINT, SIGKILL, SIGSTOP, SIGTERM
from typing import Any, Final

from tools.chaos.scenario import full_disk, kill, wire
from tools.chaos.scenarios import ALL, SCENARIOS, STEP_CLOCK

from . import bounds, strikes
from .fault import Case, Fault, Strike

Rule = Callable[[random.Random], Fault]
"""A rule of the grammar: it draws what its fault leaves open."""

FIRST_S: Final = (0.3, 3.0)
"""Range of the first strike, s: the recording has begun, and half the test is still to come."""
SOON_S: Final = 0.6
"""Half of the second strikes come within this time, s, so while the rig is being made safe."""
LATER_S: Final = 2.0
"""The other ones come within this time, s, after the first."""
PLOTS_EVERY: Final = 10
"""One case in so many makes the whole report."""

_TRIPS: Final = frozenset({3})
_MAY_TRIP: Final = frozenset({0, 1, 3})
_KILLED: Final = frozenset({-int(SIGKILL)})
_BY_LOOP: Final = frozenset({"loop", "daq"})
_BY_FIELD: Final = frozenset({"field", "loop", "daq"})
_BY_SUPERVISOR: Final = frozenset({"supervisor", "loop", "daq"})
_CLAIMS: Final = {scenario.name: scenario for scenario in SCENARIOS}
_ACCOUNTS: Final = (
    "POSITION_AGAINST_FLOW", "PRESSURES_CROSSED", "PRESSURE_ABOVE_SUPPLY", "ENCODER_FROZEN",
    "ENCODER_JUMP", "LIMIT_HIGH", "LIMIT_LOW",
)  # fmt: skip
"""Causes that two wrong transducers can lead to together, as several are compared."""
_PAUSED: Final = {
    "loop": ("WATCHDOG_TRIPPED", "STALE_SAMPLE", "LOOP_LOST", "OVERRUN"),
    "field": ("FIELD_LOST", "BYPASS_LOST", "DRIVE_LOST", "PUMP_LOST"),
    "recorder": ("RECORDER_LOST",),
    "supervisor": ("SUPERVISOR_LOST",),
    "publisher": (),
    "emulator": (
        "WATCHDOG_TRIPPED", "STALE_SAMPLE", "BYPASS_LOST", "DRIVE_LOST", "PUMP_LOST",
        "EXCHANGE_LOST", "DEVICE_STOPPED", "METERS_LOST",
    ),
}  # fmt: skip
"""Causes of a trip that a pause of a part may lead to."""


def _claimed(scenario: str, **given: Any) -> Fault:
    """Return the fault of a scenario with its steps and claims, but for what is `given`."""
    known = _CLAIMS[scenario]
    trips = bool(known.causes)
    return Fault(
        **{
            "name": known.name,
            "steps": known.steps,
            "causes": known.causes,
            "null_ms": known.null_ms if trips else None,
            "exits": frozenset({known.exit_code}) if trips else frozenset({0, 1}),
            "spoils": frozenset(known.unsafe),
        }
        | given
    )


def _of(*scenarios: str, **given: Any) -> Rule:
    return lambda rng: _claimed(rng.choice(scenarios), **given)


def _killed(rng: random.Random) -> Fault:
    part = rng.choice((*ALL, "publisher"))
    name = f"{part}: kill -9"
    steps = (kill(SIGKILL, part),)
    if part == "publisher":
        return Fault(name, steps, at_emulator=False)
    needs = {
        "loop": frozenset[str](), "field": _BY_SUPERVISOR, "recorder": _BY_SUPERVISOR,
        "supervisor": _BY_LOOP,
    }[part]  # fmt: skip
    given = {"steps": steps, "needs": needs, "takes": frozenset({part}), "at_emulator": False}
    if part == "supervisor":
        # It takes its own report with it, and may be killed while it writes a file.
        given |= {"exits": _KILLED, "keeps_results": False}
    return _claimed(name, **given)


def _stopped(rng: random.Random) -> Fault:
    part = rng.choice((*ALL, "publisher"))
    name = f"{part}: SIGSTOP"
    steps = (kill(SIGSTOP, part),)
    if part == "publisher":
        return Fault(name, steps, stops=(part,), at_emulator=False)
    needs = frozenset[str]() if part == "loop" else _BY_LOOP
    return _claimed(
        name, steps=steps, needs=needs, takes=frozenset({part}), stops=(part,), at_emulator=False
    )


def _paused(rng: random.Random) -> Fault:
    part = rng.choice(tuple(_PAUSED))
    seconds = round(rng.uniform(0.01, 1.5), 3)
    return Fault(
        f"{part}: stopped for {1e3 * seconds:.0f} ms",
        (strikes.pause(part, seconds),),
        _PAUSED[part],
        # What is stopped cannot act meanwhile, and its devices are heard late.
        takes=frozenset({"daq", "bypass", "drive", "pump"} if part == "emulator" else {part}),
        exits=_MAY_TRIP if _PAUSED[part] else frozenset({0, 1}),
    )


def _signalled(rng: random.Random) -> Fault:
    number = rng.choice((SIGINT, SIGTERM, SIGHUP))
    return _claimed(f"supervisor: {number.name}", needs=_BY_SUPERVISOR, at_emulator=False)


_WIRES: Final = (
    "replies 5 s late", "replies lost", "requests lost", "garbage", "wrong transaction id",
    "exception 4 to each request", "connection broken, no other accepted",
)  # fmt: skip


def _wire(rng: random.Random) -> Fault:
    device, kind = (
        rng.choice((("daq", "I/O node"), ("bypass", "bypass valves"))),
        rng.choice(_WIRES),
    )
    target, title = device
    needs = frozenset({"loop"}) if target == "daq" else _BY_FIELD
    return _claimed(f"{title}: {kind}", needs=needs, takes=frozenset({target}))


def _brief_wire(rng: random.Random) -> Fault:
    target = rng.choice(("daq", "bypass"))
    fault = rng.choice(("drop", "garbage", "wrong_transaction", "exception", "disconnect"))
    milliseconds = rng.randint(1, 400)
    causes = (
        ("STALE_SAMPLE", "WATCHDOG_TRIPPED", "EXCHANGE_LOST")
        if target == "daq"
        else ("BYPASS_LOST",)
    )
    return Fault(
        f"{target}: {fault} for {milliseconds} ms",
        (wire(fault, target, lasts=f"{milliseconds} ms"),),
        causes,
        takes=frozenset({target}),
        lasts_ms=float(milliseconds),
        exits=_MAY_TRIP,
    )


def _sensor(rng: random.Random) -> Fault:
    name = rng.choice(
        (
            "encoder: frozen", "encoder: loses 1000 counts", "encoder: loses a count and says so",
            "encoder: no position", "pressure 1: frozen", "pressure 1: not a number",
            "pressure 1: at its low end", "pressure 2: at its high end",
            "pressure 1: drifts by 5 MPa/s",
        )
    )  # fmt: skip
    given: dict[str, Any] = {}
    if name == "encoder: frozen":
        given["null_ms"] = (_CLAIMS[name].null_ms or 0.0) + bounds.TURNING.ms
    return _claimed(name, needs=_BY_LOOP, is_sensor=True, **given)


def _clock(rng: random.Random) -> Fault:
    parts = tuple(part for part in ALL if rng.random() < 0.5) or ("supervisor",)
    return Fault(
        f"wall clock: stepped by an hour in {', '.join(parts)}",
        (kill(STEP_CLOCK, *parts),),
        at_emulator=False,
    )


def _disk(rng: random.Random) -> Fault:
    if rng.random() < 0.3:
        return Fault(
            "run's folder: removed",
            (strikes.remove_folder,),
            ("stopped by the loss of its folder",),
            bounds.FOLDER_REMOVED.ms,
            _TRIPS,
            needs=_BY_SUPERVISOR,
            at_emulator=False,
            keeps_folder=False,
        )
    parts = rng.choice((("recorder",), ALL))
    return _claimed(
        f"disk: full for {'all' if len(parts) > 1 else 'the recorder'}",
        steps=(full_disk(*parts),),
        needs=_BY_SUPERVISOR | {"recorder"},
        at_emulator=False,
        keeps_results=len(parts) == 1,
    )


def _others(rng: random.Random) -> Fault:
    name, step = rng.choice(
        (
            ("another master: writes full extension", strikes.foreign_write),
            ("another master: claims the node", strikes.foreign_claim),
        )
    )
    return Fault(
        name, (step,), ("FOREIGN_MASTER",), bounds.FOREIGN_MASTER.ms, _TRIPS, needs=_BY_LOOP
    )


def _hostile(rng: random.Random) -> Fault:
    name, step = rng.choice(
        (
            ("stream: a forged end of the campaign", strikes.forge_stream),
            ("I/O node: a connection that speaks no Modbus", strikes.no_modbus),
        )
    )
    return Fault(name, (step,))


def _nulled(rng: random.Random) -> Fault:
    causes = ("VALVE_NOT_ENABLED", "COMMAND_ECHO", "WATCHDOG_TRIPPED")
    claimed_ms = _CLAIMS["emergency stop: pressed"].null_ms
    return Fault(
        "I/O node: somebody asks for null", (strikes.null_request,), causes, claimed_ms, _TRIPS,
        needs=_BY_LOOP,
    )  # fmt: skip


def _hung(rng: random.Random) -> Fault:
    return _claimed(
        "all devices: hang for 3 s",
        causes=_PAUSED["emulator"],
        takes=frozenset({"daq", "bypass", "drive", "pump"}),
    )


GROUPS: Final[dict[str, tuple[Rule, ...]]] = {
    "process killed": (_killed,),
    "process stopped": (_stopped,),
    "process paused": (_paused,),
    "signal": (_signalled,),
    "wire": (_wire,),
    "wire, briefly": (_brief_wire,),
    "I/O node": (
        _of("I/O node: its last sample for ever", needs=_BY_LOOP, takes=frozenset({"daq"})),
        _nulled,
    ),
    "transducer": (_sensor,),
    "servovalve": (
        _of("servovalve: spool stuck", needs=_BY_LOOP),
        _of("valve drive: silent", needs=_BY_FIELD, takes=frozenset({"drive"})),
        _of("valve drive: fault 0x3100", needs=_BY_FIELD),
    ),
    "emergency stop": (_of("emergency stop: pressed", "emergency stop: pressed for 0.5 s"),),
    "slow device": (
        _of("bypass valves: one does not shut in an emergency stop"),
        _of("pump unit: silent", needs=_BY_FIELD, takes=frozenset({"pump"})),
        _of("pump unit: stays loaded in an emergency stop"),
    ),
    "nonsense": (
        _of(
            "flow meters: unplugged, for 1 s", "flow meters: noise on the line, for 1 s",
            "CAN: nonsense from the valve drive", "CAN: nonsense from the pump unit",
        ),
        _hostile,
    ),
    "all devices": (_hung,),
    "wall clock": (_clock,),
    "disk": (_disk,),
    "another master": (_others,),
}  # fmt: skip
"""The rules by what fails; each group is as likely as another."""


def draw(seed: int, number: int) -> Case:
    """Return a case, which depends on seed and number alone.

    Its two faults are of different groups, so that the second is no repetition of the first.
    """
    rng = random.Random(f"chaos {seed} {number}")
    groups = rng.sample(tuple(GROUPS), 2)
    first, second = (rng.choice(GROUPS[group])(rng) for group in groups)
    at_s = rng.uniform(*FIRST_S)
    gap_s = rng.uniform(0.0, SOON_S if rng.random() < 0.5 else LATER_S)
    return Case(
        seed,
        number,
        (Strike(at_s, first), Strike(at_s + gap_s, second)),
        with_plots=number % PLOTS_EVERY == 0,
    )


def causes_of(faults: tuple[Fault, ...]) -> set[str]:
    """Return the causes, or reasons of a stop, that faults may lead to one by one or together."""
    found = {cause for fault in faults for cause in fault.causes}
    if sum(fault.is_sensor for fault in faults) > 1:
        found |= set(_ACCOUNTS)
    return found
