"""All scenarios of the chaos suite, by what fails in them: wires, sensors, devices or processes."""

from signal import SIGCONT, SIGHUP, SIGINT, SIGKILL, SIGSTOP, SIGTERM, SIGUSR1, SIGUSR2
from typing import Any, Final

from .scenario import UNPRIVILEGED, Scenario, Step, full_disk, kill, pause, wire

STEP_CLOCK, HANG = SIGUSR1, SIGUSR2
"""Signals, by what they do in a process of the stage; see hooks/sitecustomize.py."""

ALL: Final = ("supervisor", "loop", "field", "recorder")
KILLED: Final = -int(SIGKILL)


def _runs_on(name: str, *steps: Step, **claims: Any) -> Scenario:
    return Scenario(name, steps, exit_code=0, **claims)


BENIGN: Final = (
    _runs_on("I/O node: a reply lost", wire("drop", "daq", lasts="1 ms")),
    _runs_on(
        "I/O node: replies 3 ms late, for 0.3 s", wire("delay", "daq", by="3 ms", lasts="0.3 s")
    ),
    _runs_on("I/O node: garbage, for 10 ms", wire("garbage", "daq", lasts="10 ms")),
    _runs_on("flow meters: unplugged, for 1 s", wire("meter_unplugged", lasts="1 s")),
    _runs_on("flow meters: noise on the line, for 1 s", wire("meter_noise", lasts="1 s")),
    _runs_on("CAN: nonsense from the valve drive", wire("can_garbage", "drive")),
    _runs_on("CAN: nonsense from the pump unit", wire("can_garbage", "pump")),
    _runs_on("wall clock: stepped by an hour", kill(STEP_CLOCK, *ALL)),
    _runs_on("privilege: no real-time priority, no locked memory", pause(0.0), prefix=UNPRIVILEGED),
)  # fmt: skip

_FAILING_WIRE: Final[tuple[tuple[str, str, dict[str, Any]], ...]] = (
    ("replies 5 s late", "delay", {"by": "5 s"}),
    ("replies lost", "drop", {}),
    ("requests lost", "drop", {"what": "requests"}),
    ("garbage", "garbage", {}),
    ("wrong transaction id", "wrong_transaction", {}),
    ("exception 4 to each request", "exception", {}),
    ("connection broken, no other accepted", "disconnect", {}),
)
WIRES: Final = (
    *(
        Scenario(
            f"I/O node: {what}",
            (wire(fault, "daq", **options),),
            ("EXCHANGE_LOST",) if fault == "disconnect" else ("STALE_SAMPLE", "WATCHDOG_TRIPPED"),
            null_ms=350,
        )
        for what, fault, options in _FAILING_WIRE
    ),
    Scenario(
        "I/O node: its last sample for ever", (wire("frozen", "daq"),), ("DEVICE_DEAF",), 50,
        mentions=("valve null NOT CONFIRMED",),
    ),
    *(
        Scenario(
            f"bypass valves: {what}", (wire(fault, "bypass", **options),), ("BYPASS_LOST",), 500,
            mentions=("bypass shut NOT CONFIRMED",), ordered=False,
        )
        for what, fault, options in _FAILING_WIRE
    ),
)  # fmt: skip

_SENSOR: Final[tuple[tuple[str, Step, tuple[str, ...], float], ...]] = (
    ("encoder: frozen", wire("frozen", "position_m"), ("ENCODER_FROZEN", "POSITION_AGAINST_FLOW"),
     200),
    ("encoder: loses 1000 counts", wire("lost_counts", counts=1000), ("ENCODER_JUMP",), 20),
    ("encoder: loses a count and says so", wire("lost_counts", counts=1, flagged=True),
     ("ENCODER_FAULT",), 20),
    ("encoder: no position", wire("sensor", "position_m", reads="nan"), ("ENCODER_FAULT",), 20),
    ("pressure 1: frozen", wire("frozen", "pressure_1_Pa"), ("SENSOR_FROZEN",), 100),
    ("pressure 1: not a number", wire("sensor", "pressure_1_Pa", reads="nan"), ("SENSOR_NAN",), 20),
    ("pressure 1: at its low end", wire("sensor", "pressure_1_Pa", reads="low"),
     ("SENSOR_FROZEN",), 100),
    ("pressure 2: at its high end", wire("sensor", "pressure_2_Pa", reads="high"),
     ("SENSOR_RANGE", "LIMIT_HIGH"), 20),
    ("pressure 1: drifts by 5 MPa/s", wire("sensor", "pressure_1_Pa", reads="drift", rate=5e6),
     ("PRESSURE_ABOVE_SUPPLY", "LIMIT_HIGH", "POSITION_AGAINST_FLOW", "PRESSURES_CROSSED"), 5000),
    ("servovalve: spool stuck", wire("stuck_valve"), ("SPOOL_NOT_FOLLOWING",), 1000),
)  # fmt: skip
SENSORS: Final = tuple(
    Scenario(name, (step,), causes, null_ms) for name, step, causes, null_ms in _SENSOR
)

DEVICES: Final = (
    Scenario("emergency stop: pressed", (wire("estop"),), ("ESTOP_OPEN",), 20),
    Scenario(
        "emergency stop: pressed for 0.5 s", (wire("estop", lasts="0.5 s"),), ("ESTOP_OPEN",), 20
    ),
    Scenario(
        "bypass valves: one does not open", (wire("stuck_bypass", "external_leakage_1"),),
        ("BYPASS_STUCK",), 15_000,
    ),
    Scenario(
        "bypass valves: one does not shut in an emergency stop",
        (wire("stuck_bypass", "internal_leakage"), wire("estop")), ("ESTOP_OPEN",), 20,
        mentions=("bypass shut NOT CONFIRMED",), unsafe=("bypass",),
    ),
    Scenario(
        "valve drive: silent", (wire("can_silence", "drive"),), ("DRIVE_LOST",), 1000, ordered=False
    ),
    Scenario(
        "valve drive: fault 0x3100", (wire("drive_fault"),), ("DRIVE_FAULT", "SPOOL_NOT_FOLLOWING"),
        200, mentions=("emergency 0x3100",),
    ),
    Scenario("pump unit: silent", (wire("can_silence", "pump"),), ("PUMP_LOST",), 1000),
    Scenario(
        "pump unit: stays loaded in an emergency stop",
        (wire("stuck_can", "pump"), wire("estop")), ("ESTOP_OPEN",), 20,
        mentions=("pump unloaded NOT CONFIRMED",), unsafe=("pump",),
    ),
    Scenario(
        "all devices: hang for 3 s",
        (kill(SIGSTOP, "emulator"), pause(3.0), kill(SIGCONT, "emulator")),
        ("BYPASS_LOST", "STALE_SAMPLE", "WATCHDOG_TRIPPED"), 350,
    ),
    Scenario(
        "all devices: lose power", (kill(SIGKILL, "emulator"),), ("EXCHANGE_LOST",),
        mentions=(
            "valve null NOT CONFIRMED", "bypass shut NOT CONFIRMED", "pump unloaded NOT CONFIRMED",
        ),
        unsafe=("valve", "bypass", "pump"),
    ),
)  # fmt: skip

PROCESSES: Final = (
    Scenario("loop: kill -9", (kill(SIGKILL, "loop"),), ("LOOP_LOST",), 350),
    Scenario("loop: SIGSTOP", (kill(SIGSTOP, "loop"),), ("LOOP_LOST",), 350),
    Scenario("field: kill -9", (kill(SIGKILL, "field"),), ("FIELD_LOST",), 50, ordered=False),
    Scenario("field: SIGSTOP", (kill(SIGSTOP, "field"),), ("FIELD_LOST",), 1100, ordered=False),
    Scenario("recorder: kill -9", (pause(2.0), kill(SIGKILL, "recorder")), ("RECORDER_LOST",), 50),
    Scenario(
        "recorder: SIGSTOP", (pause(2.0), kill(SIGSTOP, "recorder")), ("RECORDER_LOST",), 5200
    ),
    Scenario(
        "supervisor: kill -9", (kill(SIGKILL, "supervisor"),), ("SUPERVISOR_LOST",), 150, KILLED
    ),
    Scenario(
        "supervisor: SIGSTOP", (kill(SIGSTOP, "supervisor"),), ("SUPERVISOR_LOST",), 1100,
        then=(kill(SIGCONT, "supervisor"),),
    ),
    Scenario(
        "supervisor: its main thread hangs", (kill(HANG, "supervisor"),), ("SUPERVISOR_LOST",),
        6200, KILLED, then=(kill(SIGKILL, "supervisor"),),
    ),
    Scenario(
        "supervisor and field: kill -9", (kill(SIGKILL, "supervisor", "field"),),
        ("SUPERVISOR_LOST",), 150, KILLED, ordered=False,
    ),
    Scenario(
        "loop and field: kill -9", (kill(SIGKILL, "loop", "field"),),
        ("LOOP_LOST", "FIELD_LOST"), 350, ordered=False,
    ),
    Scenario(
        "all processes: kill -9", (pause(2.0), kill(SIGKILL, *ALL)), ("",), 350, KILLED,
        ordered=False,
    ),
    *(
        Scenario(
            f"supervisor: {number.name}", (kill(number, "supervisor"),),
            (f"stopped by {number.name}",), 1000, ordered=False,
        )
        for number in (SIGINT, SIGTERM, SIGHUP)
    ),
    Scenario(
        "disk: full for the recorder", (pause(2.0), full_disk("recorder")), ("DISK_FULL",), 1500
    ),
    Scenario(
        "disk: full for all", (pause(2.0), full_disk(*ALL)), ("DISK_FULL",), 1500
    ),
)  # fmt: skip

SCENARIOS: Final = (*BENIGN, *WIRES, *SENSORS, *DEVICES, *PROCESSES)
