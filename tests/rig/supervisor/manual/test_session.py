"""A manual session obeys in the right state only, and comes to rest when nobody holds on."""

import queue
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rig.supervisor.manual.session as session
from rig.configuration import Rig, load_model, load_rig
from rig.loop import Action, Cause, SetAhead, StopRequestedError, Word, set_ahead
from rig.supervisor.manual.commands import Asked, parse
from rig.supervisor.manual.session import Inbox, Manual
from rig.supervisor.states import Conditions, Event, State, next_state
from tests.waiting import until


@pytest.fixture(scope="module")
def emulated() -> Rig:
    return load_rig("emulated")


class FakeRig:
    """An armed and homed rig whose loop follows a segment as the fake time goes on."""

    def __init__(self, configured: Rig) -> None:
        self.configured, self.model = configured, load_model("nominal")
        self.state = State.ARMED
        words = np.zeros(64, np.int64)
        self.board = SimpleNamespace(words=words)
        self.parts = SimpleNamespace(loop="loop", field="field")
        self.laid_out = np.full(1, 0.3), np.zeros(1)
        self.written: dict[str, float] = {}
        self.followed: list[float] = []
        self.stops = False
        self.taken = True

    def check(self) -> None:
        if self.stops:
            raise StopRequestedError("stopped by SIGINT")

    def note(self, who: str, what: str) -> None:
        pass

    def handle(self, event: Event) -> None:
        now = Conditions(estop_closed=True, valve_enabled=True, homed=True)
        self.state = next_state(self.state, event, now)

    def latest(self, channel: str) -> float:
        setpoint, place = self.laid_out[0], int(self.board.words[Word.TICK])
        return float(setpoint[min(place, setpoint.size - 1)]) if channel != "x" else 0.0

    def slow(self, channel: str) -> float:
        return self.written.get(channel, 0.0)

    def off(self, wanted: dict[str, float]) -> list[str]:
        return [name for name in wanted if name != "return_blockage_ball"]

    def write(self, outputs: dict[str, float]) -> None:
        self.written |= outputs

    def switch_to(self, drive: object, **changes: Any) -> None:
        words = self.board.words
        words[Word.SWITCH] += 1
        words[Word.SEGMENT], words[Word.TICK] = words[Word.SWITCH], 0
        words[Word.ACTION] = Action.NONE
        setpoint = changes.get("setpoint", np.full(1, self.latest("setpoint_m")))
        guide = changes.get("guide")
        self.laid_out = setpoint, np.zeros(setpoint.size) if guide is None else guide.feedforward

    def wait(self, done: Callable[[], bool], *_: object) -> None:
        assert done()

    def ask(self, part: object, order: object, timeout_s: float) -> Any:
        if isinstance(order, SetAhead):
            return self.taken and set_ahead(order, *self.laid_out, self.board.words)
        return {}

    def ramp_down(self) -> None:
        self.state = State.DISARMED

    def goes_on(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.followed.append(self.latest("setpoint_m"))
            self.board.words[Word.TICK] += 1


class Script(Inbox):
    """An inbox that hands over lines at their times, and keeps the answers."""

    def __init__(self, clock: "Clock", lines: dict[float, str], *, remote: bool = False) -> None:
        super().__init__()
        self._clock, self._lines, self._remote = clock, dict(sorted(lines.items())), remote
        self.answers: dict[str, queue.SimpleQueue[str]] = {}
        self.told: list[tuple[str, str]] = []

    def take(self) -> tuple[Asked, str, bool, "queue.SimpleQueue[str]"] | None:
        due = [at for at in self._lines if at <= self._clock.now]
        if not due:
            return None
        line = self._lines.pop(due[0])
        self.heard_at = self._clock.now
        if line.startswith("beat"):
            self.ask(line, "Bo", remote=False)
            return self.take()
        answer = self.answers[line] = queue.SimpleQueue()
        return parse(line), "Bo", self._remote, answer

    def said(self, line: str) -> str:
        return self.answers[line].get_nowait()


class Clock:
    def __init__(self, rig: FakeRig) -> None:
        self.now, self._rig = 100.0, rig

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self._rig.goes_on(seconds)


@pytest.fixture
def rig(emulated: Rig) -> FakeRig:
    return FakeRig(emulated)


@pytest.fixture
def clock(rig: FakeRig, monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(rig)
    monkeypatch.setattr(session, "time", clock)
    return clock


def carried_out(
    rig: FakeRig, clock: Clock, lines: dict[float, str], until_s: float, *, remote: bool = False
) -> tuple[Script, list[str]]:
    """Carry out lines, by the times in s after the begin at which they come."""
    said: list[str] = []
    inbox = Script(clock, {100.0 + at: line for at, line in lines.items()}, remote=remote)
    told = inbox.told.append
    manual = Manual(rig, inbox, said.append, lambda *motion: told(motion))  # type: ignore[arg-type]
    manual.run(lambda: clock.now >= 100.0 + until_s)
    return inbox, said


def test_a_jog_ends_where_it_is_to_and_says_so(rig: FakeRig, clock: Clock) -> None:
    inbox, said = carried_out(rig, clock, {0.0: "by 5mm"}, 1.0)
    assert inbox.said("by 5mm") == ""
    assert rig.latest("setpoint_m") == pytest.approx(0.305)
    assert rig.state is State.ARMED
    assert said == ["by 5 mm: done, the ram is at 305.00 mm"]
    assert inbox.told == [("by 5 mm", ""), ("", said[0])]


@pytest.mark.parametrize(
    ("lines", "how"),
    [
        ({0.0: "hold out"}, "hold out: ended, as no heartbeat came in time"),
        ({0.0: "hold out", 0.1: "stop"}, "hold out: brought to rest"),
        ({0.0: "to 0.4m", 0.5: "stop"}, "to 0.4 m: brought to rest"),
    ],
)
def test_how_a_motion_ended_is_told_with_what_it_was(
    rig: FakeRig, clock: Clock, lines: dict[float, str], how: str
) -> None:
    inbox, said = carried_out(rig, clock, lines, 2.0)
    assert said[-1].startswith(f"{how}, the ram is at ")
    assert inbox.told[-1] == ("", said[-1])


def test_hold_to_run_rests_soon_after_the_last_heartbeat(rig: FakeRig, clock: Clock) -> None:
    beats = {0.05 * k: f"beat {50 * k}" for k in range(1, 21)}
    carried_out(rig, clock, {0.0: "hold out"} | beats, 2.0)
    moved = np.flatnonzero(np.diff(rig.followed))
    assert 1000 < moved[-1] < 1000 + 250
    assert rig.followed[-1] - rig.followed[1000] < 0.005


def test_heartbeats_that_were_kept_up_on_their_way_do_not_count(rig: FakeRig, clock: Clock) -> None:
    timely = {0.05 * k: f"beat {50 * k}" for k in range(1, 11)}
    kept_up = {0.5 + 0.05 * k: f"beat {350 + 50 * k}" for k in range(1, 20)}
    carried_out(rig, clock, {0.0: "hold out"} | timely | kept_up, 2.0)
    assert np.flatnonzero(np.diff(rig.followed))[-1] < 500 + 250


@pytest.mark.parametrize("line", ["by 5mm", "to 0.3m", "hold out", "bypass internal_leakage open"])
@pytest.mark.parametrize("state", [State.DISARMED, State.NOT_HOMED])
def test_nothing_is_moved_before_homing(
    rig: FakeRig, clock: Clock, line: str, state: State
) -> None:
    rig.state = state
    inbox, _ = carried_out(rig, clock, {0.0: line}, 0.2)
    assert "home" in inbox.said(line)
    assert not rig.written
    assert len(rig.laid_out[0]) == 1


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("to 700mm", "not between 7 mm and"),
        ("by -400mm", "not between 7 mm and"),
        ("to 0.3m speed 2m/s", "at most 0.3507 m/s"),
        ("hold out speed 50mm/s", "at most 20 mm/s"),
        ("pump low", "low is not possible"),
        ("pump high", "loaded already"),
        ("home", "the rig is homed"),
        ("bypass nose open", "none that this rig moves"),
        ("bypass return_blockage open", "no ball valve"),
        ("generator amplitude 5mm", "frequency is missing"),
        ("generator sine amplitude 200mm frequency 1Hz", "speed"),
    ],
)
def test_what_is_not_allowed_is_refused(rig: FakeRig, clock: Clock, line: str, why: str) -> None:
    inbox, _ = carried_out(rig, clock, {0.0: line}, 0.2)
    assert why in inbox.said(line)
    assert len(set(rig.followed)) == 1
    assert rig.state is State.ARMED


def test_a_wave_is_not_changed_before_the_ram_is_at_its_mean_which_needs_no_stop(
    rig: FakeRig, clock: Clock
) -> None:
    change = "generator amplitude 20mm"
    lines = {0.0: "generator sine mean 350mm amplitude 10mm frequency 0.5Hz", 0.5: change}
    inbox, _ = carried_out(rig, clock, lines, 1.0)
    assert "on its way to the wave's mean" in inbox.said(change)


def test_a_bypass_is_moved_by_hand_and_shown_with_its_meter(rig: FakeRig, clock: Clock) -> None:
    lines = {0.0: "bypass internal_leakage open", 0.1: "bypass internal_leakage 30%"}
    _, said = carried_out(rig, clock, lines, 4.0)
    assert rig.written == {"internal_leakage_ball": 1.0, "internal_leakage_needle": 0.3}
    assert "internal_leakage: open, needle 30 %, meter" in said[0]


def test_a_limit_that_holds_the_ram_ends_the_motion_and_is_named(
    rig: FakeRig, clock: Clock
) -> None:
    def strike(seconds: float) -> None:
        if clock.now > 100.5 and not struck:
            struck.append(True)
            rig.board.words[Word.ACTION] = Action.HOLD
            rig.board.words[Word.ACTION_CAUSE] = Cause.TEST_LIMIT
        sleep(seconds)

    struck: list[bool] = []
    sleep, clock.sleep = clock.sleep, strike  # type: ignore[method-assign]
    _, said = carried_out(rig, clock, {0.0: "to 0.4m", 1.0: "by 1mm"}, 2.0)
    assert "to 0.4 m: held: " in said[0]
    assert said[1].startswith("by 1 mm: done")


def test_unloading_the_pump_disarms_the_valve_and_makes_all_safe(
    rig: FakeRig, clock: Clock
) -> None:
    inbox, said = carried_out(rig, clock, {0.0: "pump unloaded", 0.1: "by 1mm"}, 0.3)
    assert rig.state is State.DISARMED
    assert said == ["pump unloaded, bypasses shut, valve at null and disabled"]
    assert "`pump high`, then `home`" in inbox.said("by 1mm")


def test_a_stop_that_somebody_asks_for_ends_the_session(rig: FakeRig, clock: Clock) -> None:
    rig.stops = True
    with pytest.raises(StopRequestedError, match="SIGINT"):
        carried_out(rig, clock, {}, 1.0)


def test_a_page_that_moves_the_ram_and_falls_silent_ends_the_session(
    rig: FakeRig, clock: Clock
) -> None:
    wave = "generator sine amplitude 10mm frequency 0.5Hz"
    with pytest.raises(StopRequestedError, match="silent for 3 s"):
        carried_out(rig, clock, {0.0: wave}, 10.0, remote=True)
    assert clock.now == pytest.approx(103.0, abs=0.1)


def test_a_page_that_is_silent_while_the_ram_rests_does_no_harm(rig: FakeRig, clock: Clock) -> None:
    carried_out(rig, clock, {0.0: "by 1mm"}, 6.0, remote=True)
    assert rig.state is State.ARMED


def test_a_loop_that_takes_nothing_lets_the_ram_rest(rig: FakeRig, clock: Clock) -> None:
    rig.taken = False
    carried_out(rig, clock, {0.0: "to 0.4m"}, 1.0)
    assert len(set(rig.followed)) == 1


def test_a_command_that_was_not_looked_at_in_time_is_never_obeyed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(session, "ANSWER_S", 0.01)
    inbox = Inbox()
    inbox.busy = ""
    assert "was not looked at" in inbox.ask("by 5mm", "Bo", remote=False)
    assert inbox.take() is None


def test_a_command_that_is_begun_late_is_not_said_to_be_left_aside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(session, "ANSWER_S", 0.05)
    inbox, said = Inbox(), list[str]()
    inbox.busy = ""
    asking = threading.Thread(target=lambda: said.append(inbox.ask("stop", "Bo", remote=True)))
    asking.start()
    until(lambda: (item := inbox.take()) is not None and item[0].what == "stop", "the command")
    asking.join()
    assert said == ["stop: was begun, but not answered within 0.1 s; look at the ram"]


def test_a_command_is_refused_while_the_rig_is_busy() -> None:
    inbox = Inbox()
    assert "is being connected" in inbox.ask("by 5mm", "Bo", remote=True)
    assert inbox.ask("beat", "Bo", remote=True) == ""
    assert "is no command" in inbox.ask("jump", "Bo", remote=False)
