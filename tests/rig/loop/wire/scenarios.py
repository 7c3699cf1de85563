"""Runs the loop on the wire with a clock and a device that each scenario controls.

`NUMBA_DISABLE_JIT=1 python scenarios.py` prints, as JSON by scenario, the frames that the device
received and the rows in the ring. The functions must not be compiled, because clock and exchange
are patched.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import date
from types import SimpleNamespace
from typing import Any

import numpy as np

from control import PLAIN, PROPORTIONAL, Guide
from estimator.filters.registry import (
    OUTPUTS,
    compiled_filter,
    filter_step,
    run_filter,
    start_memory,
)
from rig.io.correction import corrections_of
from rig.io.driver import ExchangeStatus
from rig.io.settings import HomingSettings, LoopSettings
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.io.wiring import Wiring
from rig.loop import cycle
from rig.loop.board import DECISIONS_KEPT, Board, Word
from rig.loop.decided import DECIDED, Decided
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.interlocks.judging import interlock
from rig.loop.interlocks.ladder import Action, Cause, limit_table
from rig.loop.reaction import Reaction
from rig.loop.wire import cycle as wire_cycle, null_check
from rig.loop.wire.following import skip_order
from rig.loop.wire.layout import Count, Course, Drive, Found, Left, pace, wire_channels, wire_memory
from rig.loop.wire.loop import post_decision
from rig.loop.wire.orders import (
    ChangeControl,
    Segment,
    changed_course,
    control_in,
    course,
    prepared,
)
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET

MS = 1_000_000
BEGIN = 1_000 * MS
MODEL = Model()
MEMORY = start_memory("product", MODEL)
CHANNELS = wire_channels(MEMORY.filter.states, open_loop=False)
FD = 3
CALIBRATION = TransducerCalibration(
    "pressure_1_Pa",
    "PT-1",
    date(2026, 3, 2),
    date(2027, 3, 2),
    (CalibrationPoint(0.0, 0.0), CalibrationPoint(1e7, 1.1e7)),
)


@dataclass
class World:
    """A clock, and a device that obeys commands at once, with deviations that a scenario sets.

    Attributes:
        late: by tick, how much too late the loop wakes, ns; 20 us if not given.
        before: by tick, a function that is called with the board before the loop wakes.
        status: by number of the exchange from 0, its status; OK if not given.
        verdicts: by tick from 0, the result of the interlock; no action if not given.
        deaf: whether the device ignores all commands and stays enabled at 1 V.
        same_sample: numbers of the exchanges that return the previous sample again.
        other: by tick, signals that another master changes on the device before the loop wakes.
        changes: the changes of control that the loop finds prepared, by their numbers.
        calibrations: calibrations of the transducers.
        wiring: how the device is wired.
    """

    late: dict[int, int] = field(default_factory=dict)
    before: dict[int, Callable[[Board], None]] = field(default_factory=dict)
    status: dict[int, ExchangeStatus] = field(default_factory=dict)
    verdicts: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    deaf: bool = False
    same_sample: frozenset[int] = frozenset()
    other: dict[int, dict[str, float]] = field(default_factory=dict)
    changes: dict[int, ChangeControl] = field(default_factory=dict)
    calibrations: tuple[TransducerCalibration, ...] = ()
    wiring: Wiring = field(default_factory=Wiring)

    def __post_init__(self) -> None:
        self.now = BEGIN
        self.board = Board.create(len(CHANNELS))
        corrections = corrections_of(self.calibrations, self.wiring)
        self.memory = wire_memory()._replace(corrections=corrections)
        self.plan = SimpleNamespace()
        self.look = SimpleNamespace()
        self.looks = 0
        self.frames: list[tuple[int, dict[str, float]]] = []
        self.sleeps: set[int] = set()
        self.judged = 0
        self.position = 0.3
        stuck = float(self.deaf)
        self.device = {"valve_enabled": stuck, "device_command_V": stuck, "spool_m": 0.0}

    def sleep_until(self, time_ns: int) -> None:
        """Advance the clock to a time, plus the delay of that tick, in place of sleeping."""
        tick = (time_ns - BEGIN) // MS - 1
        self.now = max(self.now, time_ns)
        if tick not in self.sleeps:
            self.sleeps.add(tick)
            self.device |= self.other.get(tick, {})
            self.before.get(tick, lambda board: None)(self.board)
            self.now += self.late.get(tick, 20_000)

    def exchange(self, fd: int, plan: Any, sequence: int, outputs: Any, inputs: Any,
                 deadline_ns: int) -> tuple[int, int]:  # fmt: skip
        """Receive a frame with outputs and answer with a sample; a look has no outputs.

        It replaces the compiled exchange, and returns status and time of sending (ns), which is 0
        if the device is disconnected.
        """
        if plan is self.look:
            self.looks += 1
            self.now += 20_000
            inputs[:] = np.nan
            for name, value in self.device.items():
                inputs[FAST_INPUTS.index(name)] = value
            return int(ExchangeStatus.OK), 0
        number = len(self.frames)
        sent = dict(zip(FAST_OUTPUTS, (float(value) for value in outputs), strict=True))
        self.frames.append((self.now, sent))
        status = self.status.get(number, ExchangeStatus.OK)
        gone = status != ExchangeStatus.DISCONNECTED
        left_ns = self.now + 30_000 if gone else 0
        self.now = deadline_ns if status == ExchangeStatus.TIMEOUT else self.now + 50_000
        inputs[:] = np.nan
        if status == ExchangeStatus.OK:
            self._answer(number, sent, inputs)
        return int(status), left_ns

    def _answer(self, number: int, sent: dict[str, float], inputs: Any) -> None:
        if not self.deaf:
            self.device |= {
                "valve_enabled": sent["valve_enable"],
                "device_command_V": sent["command_V"],
            }
        counter = number - 1 if number in self.same_sample else number
        sample = self.device | {
            "position_m": self.position + 1e-5 * number,
            "pressure_1_Pa": 7e6,
            "pressure_2_Pa": 7e6,
            "device_counter": float(counter),
        }
        for name, value in sample.items():
            inputs[FAST_INPUTS.index(name)] = value

    def check_sample(self, *_: Any) -> tuple[int, int, int]:
        """Return the interlock's result that the scenario sets for this tick."""
        self.judged += 1
        return self.verdicts.get(self.judged - 1, (0, 0, -1))

    def run(self, planned: Course, ticks: int, settings: LoopSettings | None = None,
            device_rate_hz: float = 1000.0, fd: int = FD,
            *, replays: bool = True) -> dict[str, Any]:  # fmt: skip
        """Run a segment for `ticks` ticks of the clock; return frames, rows and words by name.

        With `replays`, which takes as long again, also whether the filter follows from the rows.
        Without, no filter is run, which takes most of the time of a tick that is not compiled.
        """
        settings = settings or LoopSettings()
        fitted = frozenset(FAST_INPUTS[:4])
        tol = tolerances(MODEL.parameters, DATA_SHEET, fitted, TICK, 0.1, HomingSettings())
        words = self.board.words
        words[Word.SWITCH], words[Word.HOMED] = planned.number, 1
        self.before.setdefault(ticks, lambda board: board.words.__setitem__(Word.SWITCH, -1))
        memory = start_memory("product", MODEL)
        for name, stand_in in {
            "sleep_until": self.sleep_until,
            "monotonic_ns": lambda: self.now,
            "exchange": self.exchange,
            "check_sample": self.check_sample,
        }.items():
            setattr(wire_cycle, name, stand_in)
            if hasattr(null_check, name):
                setattr(null_check, name, stand_in)
        cycle.__dict__["filter_step"] = filter_step if replays else lambda *given: None
        shared = (
            compiled_filter(memory, MODEL.parameters), interlock(limit_table([], TICK), tol),
            pace(settings, device_rate_hz), fd, self.plan, self.look, self.memory, self.board,
        )  # fmt: skip
        left = wire_cycle.wire_ticks(planned, control_in(planned), *shared)
        while left == Left.CHANGED:
            number = int(words[Word.CHANGE])
            self.memory.change.state[0] = 1.0
            earlier = control_in(planned)
            planned = changed_course(planned, prepared(self.changes[number]))
            left = wire_cycle.wire_ticks(planned._replace(change=number), earlier, *shared)
        rows = self.board.ring[: int(words[Word.ROWS])]
        return {
            "left": Left(left).name,
            "frames": [{"at_ms": (at - BEGIN) / MS, **sent} for at, sent in self.frames],
            "rows": {name: rows[:, i].tolist() for i, name in enumerate(CHANNELS)},
            "words": {word.name: int(words[word]) for word in Word},
            "replays": replays and _replays(rows),
            "looks": self.looks,
            "found": {item.name: int(self.memory.found[item]) for item in Found},
        }


def _replays(rows: Any) -> bool:
    """Return whether a replay of the recorded rows gives the same filter outputs, bit for bit."""
    recorded = rows[rows[:, CHANNELS.index("segment")] >= 0]
    if not len(recorded):
        return True
    at = CHANNELS.index(OUTPUTS[0])
    again = run_filter(recorded[:, 0], recorded[:, 2].copy(), recorded[:, 3:8].copy(), MODEL)
    outputs = recorded[:, at : at + len(OUTPUTS)]
    states = recorded[:, at + len(OUTPUTS) : at + len(OUTPUTS) + again.states.shape[1]]
    return np.array_equal(again.outputs, outputs, equal_nan=True) and np.array_equal(
        again.states, states, equal_nan=True
    )


def following(setpoint: Any, **options: Any) -> Course:
    """Return a segment that follows setpoints."""
    options = {"valve_enable": True, "setpoint": setpoint} | options
    return course(Segment(1, Drive.TRACK, MEMORY, MODEL.parameters, **options))


def tracking(ticks: int = 30, **options: Any) -> Course:
    """Return a segment that follows a ramp of setpoints."""
    setpoint = 0.3 + 1e-4 * np.arange(ticks, dtype=np.float64)
    return following(setpoint, **options)


def say(word: Word, value: int) -> Callable[[Board], None]:
    """Return a function that writes `value` to a word of the board."""
    return lambda board: board.words.__setitem__(word, value)


def posted(segment: int, *values: float) -> Callable[[Board], None]:
    """Return a function that posts a decision on a segment for each value, which fills its row."""

    def post(board: Board) -> None:
        for value in values:
            post_decision(board, segment, np.full(len(DECIDED), value))

    return post


def found(at_s: float, segment: int = 1) -> Callable[[Board], None]:
    """Return a function that posts the decision that a leak is confirmed at a time."""
    row = np.zeros(len(DECIDED))
    row[Decided.AT_S], row[Decided.CONFIRMED], row[Decided.PRESENT] = at_s, 1.0, 5e-9
    return lambda board: post_decision(board, segment, row)


class Overtaken:
    """Words of a board on which `meanwhile` decisions are posted while the first one is copied."""

    def __init__(self, meanwhile: int) -> None:
        self.posted = iter((1, 1 + meanwhile))

    def __getitem__(self, word: int) -> int:
        assert word == Word.DECISIONS
        return next(self.posted)


def _overtaken(meanwhile: int) -> dict[str, Any]:
    world = World()
    posted(1, 0.5)(world.board)
    shared = world.board._replace(words=Overtaken(meanwhile))  # type: ignore[arg-type]
    wire_cycle._take_decision(1, world.memory.counts, world.memory, shared)
    return {"taken": float(world.memory.decided[0]) == 0.5}


def _leaving() -> dict[str, Any]:
    world = World()
    world.before[10] = lambda board: world.memory.counts.__setitem__(Count.LEAVE, 1)
    return world.run(tracking(), 30)


def _changed() -> dict[str, Any]:
    """A segment whose control is changed twice: to another law, and back to the thesis's."""
    changes = {1: ChangeControl(1, 1, 80.0, OTHER), 2: ChangeControl(2, 1, 50.0, PLAIN)}
    world = World(changes=changes, before={4: say(Word.CHANGE, 1), 9: say(Word.CHANGE, 2)})
    return world.run(tracking(), 14) | {"offset": float(world.memory.change.state[1])}


OTHER = Guide(PROPORTIONAL._replace(proportional=False, null_V=0.25), np.full(8, 1.5), PLAIN.tones)
GUIDE = Guide(
    PROPORTIONAL._replace(
        proportional=False, null_V=0.25, integral_rate=100.0, integral_limit_V=1.0, rest_s=1.0
    ),
    np.full(8, 1.5),
    PLAIN.tones,
    np.full(8, 0.35),
)
SETTINGS = LoopSettings(stale_limit=0.1, exchange_timeout=2e-3)
TRIP = (int(Action.TRIP), int(Cause.LIMIT_HIGH), 1)
HOLD = (int(Action.HOLD), int(Cause.LIMIT_LOW), 0)
RAMP = (int(Action.RAMP_DOWN), int(Cause.LIMIT_LOW), 0)

SCENARIOS: dict[str, Callable[[], dict[str, Any]]] = {
    "on time": lambda: World().run(tracking(), 12),
    "after the table": lambda: World().run(tracking(5), 12),
    "calibrated": lambda: World(calibrations=(CALIBRATION,)).run(tracking(), 12),
    "valve inverted": lambda: World(wiring=Wiring(valve="inverted")).run(tracking(), 12),
    "open loop": lambda: World().run(following(np.full(30, 3.0), open_loop=True, limit=2.0), 8),
    "skip setpoints": lambda: World(
        before={5: lambda board: board.words.__setitem__(Word.SKIP, skip_order(1, 20, 4))}
    ).run(tracking(), 12),
    "skip to the end": lambda: World(
        before={5: lambda board: board.words.__setitem__(Word.SKIP, skip_order(1, 30, 0))}
    ).run(tracking(), 12),
    "skip back": lambda: World(
        before={5: lambda board: board.words.__setitem__(Word.SKIP, skip_order(1, 2, 0))}
    ).run(tracking(), 12),
    "skip of another segment": lambda: World(
        before={5: lambda board: board.words.__setitem__(Word.SKIP, skip_order(7, 20, 0))}
    ).run(tracking(), 12),
    "tracking law": lambda: World().run(tracking(guide=GUIDE), 12),
    "control changed": _changed,
    "skip": lambda: World(late={5: 3_200_000}).run(tracking(), 12),
    "nearly the next tick": lambda: World(late={5: 700_000}).run(tracking(), 12),
    "a little late": lambda: World(late={5: 400_000}).run(tracking(), 12),
    "realign": lambda: World(late={5: 3_200_000}).run(
        tracking(), 12, replace(SETTINGS, overrun="realign")
    ),
    "trip below its number": lambda: World(late={5: 3_200_000}).run(
        tracking(), 12, replace(SETTINGS, overrun="trip", trip_after=4)
    ),
    "trip": lambda: World(late={5: 3_200_000}).run(
        tracking(), 12, replace(SETTINGS, overrun="trip", trip_after=3)
    ),
    "stopped for long": lambda: World(late={5: 150 * MS}).run(
        tracking(400), 160, SETTINGS, replays=False
    ),
    "device silent for long": lambda: World(
        status=dict.fromkeys(range(5, 999), ExchangeStatus.TIMEOUT)
    ).run(tracking(400), 160, SETTINGS, replays=False),
    "stopped while another trips": lambda: World(
        late={5: 30 * MS}, before={5: say(Word.FIELD_TRIP, Cause.BYPASS_STUCK)}
    ).run(tracking(400), 50, SETTINGS, replays=False),
    "timeout": lambda: World(status={5: ExchangeStatus.TIMEOUT}).run(tracking(), 12, SETTINGS),
    "no sample at first": lambda: World(
        status=dict.fromkeys(range(3), ExchangeStatus.EXCEPTION)
    ).run(tracking(), 12),
    "same sample": lambda: World(same_sample=frozenset({5})).run(tracking(), 12),
    "slow device": lambda: World().run(tracking(), 12, SETTINGS, device_rate_hz=250.0),
    "interlock trips": lambda: World(verdicts={5: TRIP}).run(tracking(), 12),
    "device deaf to the trip": lambda: World(verdicts={5: TRIP}, deaf=True).run(
        tracking(), 400, replays=False
    ),
    "driven by another master": lambda: World(
        verdicts={5: TRIP},
        other={tick: {"valve_enabled": 1.0, "device_command_V": 5.0} for tick in (20, 21, 30)},
    ).run(tracking(), 40, replays=False),
    "spool moved by another master": lambda: World(
        verdicts={5: TRIP}, other={200: {"spool_m": 2e-4}}
    ).run(tracking(), 300, replays=False),
    "lost after its trip": lambda: World(
        verdicts={5: TRIP}, status=dict.fromkeys(range(20, 99), ExchangeStatus.DISCONNECTED)
    ).run(tracking(), 90, replays=False),
    "silent after its trip": lambda: World(
        verdicts={5: TRIP}, status=dict.fromkeys(range(20, 999), ExchangeStatus.TIMEOUT)
    ).run(tracking(), 990, SETTINGS, replays=False),
    "stopped for long after its trip": lambda: World(
        verdicts={5: TRIP},
        late={20: 300 * MS},
        status=dict.fromkeys(range(20, 25), ExchangeStatus.TIMEOUT),
    ).run(tracking(), 400, replace(SETTINGS, stale_limit=1.0), replays=False),
    "disconnected": lambda: World(
        status=dict.fromkeys(range(5, 99), ExchangeStatus.DISCONNECTED)
    ).run(tracking(), 12),
    "interlock holds": lambda: World(verdicts={5: HOLD}).run(tracking(), 12),
    "interlock ramps down": lambda: World(verdicts={5: RAMP}).run(
        tracking(2000, offset_m=0.0), 520, replays=False
    ),
    "operator stops": lambda: World(before={5: say(Word.STOP, Action.HOLD)}).run(tracking(), 12),
    "supervisor silent": lambda: World(before={0: say(Word.SUPERVISOR_BEAT, BEGIN)}).run(
        tracking(400), 40, replace(SETTINGS, supervisor_silence=0.02), replays=False
    ),
    "supervisor never there": lambda: World().run(
        tracking(400), 40, replace(SETTINGS, supervisor_silence=0.02), replays=False
    ),
    "leaving": _leaving,
    "decisions": lambda: World(
        before={3: posted(1, 0.25), 6: posted(9, 0.5), 8: posted(1, *np.arange(40.0), 0.75)}
    ).run(tracking(), 12),
    "hold on a fault": lambda: World(before={5: found(0.0)}).run(
        tracking(on_fault=Reaction.HOLD), 12
    ),
    "trip on a fault": lambda: World(before={5: found(0.0)}).run(
        tracking(on_fault=Reaction.TRIP), 12
    ),
    "tolerate a leak": lambda: World(before={5: found(0.0)}).run(
        tracking(on_fault=Reaction.TOLERATE), 12
    ),
    "ignore a fault": lambda: World(before={5: found(0.0)}).run(tracking(), 12),
    "nothing to tolerate": lambda: World().run(tracking(on_fault=Reaction.TOLERATE), 12),
    "a fault of another test": lambda: World(before={5: found(0.0, 9)}).run(
        tracking(on_fault=Reaction.TRIP), 12
    ),
    "the detector falls silent": lambda: World(before={5: found(-1.99)}).run(
        tracking(on_fault=Reaction.TOLERATE), 20
    ),
    "place still whole": lambda: _overtaken(DECISIONS_KEPT - 2),
    "place written again": lambda: _overtaken(DECISIONS_KEPT - 1),
}


if __name__ == "__main__":
    print(json.dumps({name: run() for name, run in SCENARIOS.items()}))
