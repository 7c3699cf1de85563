"""A manual session: it takes commands one at a time, and moves what they ask for."""

import queue
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Final

from rig.configuration import show
from rig.loop import Action, Cause, Drive, StopRequestedError, Word, explain
from rig.plant import TICK
from rig.supervisor.arming import arm, home
from rig.supervisor.calibration import WAYS
from rig.supervisor.connected_rig import SAFE_S, ConnectedRig
from rig.supervisor.processes import MakeSafe, loop_channel
from rig.supervisor.states import Event, State

from .bounds import ALIVE_S, HOLD_SPEED, USUAL_SPEED, ManualError, bounds_of
from .commands import DIRECTIONS, HELP, Asked, parse
from .generator import SWEEP_S, Generator, Wave, check_change
from .live import Live

TURN_S: Final = 0.02
"""Period in s of the supervisor's turns; three of them are laid out ahead."""
LATE_S: Final = 0.1
"""Time in s by which a heartbeat may come later than the quickest one of its hold.

A later one was kept up on its way, and does not prove that the button is still held.
"""
REMOTE_S: Final = 3.0
"""Time in s without a sign of life after which a page that moved the ram last counts as lost."""
ANSWER_S: Final = 1.0
"""Time in s within which a command must be looked at."""
DONE: Final = "done"
"""How a motion is said to have ended that has come to where it was to."""
SETTLING_TICKS: Final = 200
"""Number of ticks after which a ram is at the setpoint that rests, but for a fine creep."""
_HOMED: Final = (State.ARMED, State.RUNNING, State.HOLDING)


Waiting = tuple[Asked, str, bool, "queue.SimpleQueue[str]"]
"""A command, who gives it, whether it came by the stream, and the queue for its answer."""


class Inbox:
    """Takes commands from several threads, and keeps them until the session looks at them."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[threading.Lock, Waiting]] = queue.SimpleQueue()
        """Each command, with the lock that the session acquires, or else who has given it up."""
        self._lock = threading.Lock()
        self._beats: list[float | None] = []
        self.busy = "the rig is being connected"
        self.heard_at = 0.0

    def ask(self, line: str, who: str, *, remote: bool) -> str:
        """Hand over a command; return why it is refused, or "" if it is obeyed.

        Args:
            line: the command.
            who: who gives it.
            remote: whether it came by the stream, from a page that may be lost.
        """
        try:
            asked = parse(line)
        except ManualError as error:
            return str(error)
        if remote:
            self.heard_at = time.monotonic()
        if asked.what == "beat":
            with self._lock:
                self._beats.append(asked.beat_ms)
            return ""
        if self.busy:
            return f"{asked.what}: {self.busy}; ask again when that is done, or stop it by abort"
        answer: queue.SimpleQueue[str] = queue.SimpleQueue()
        claim = threading.Lock()
        self._waiting.put((claim, (asked, who, remote, answer)))
        with suppress(queue.Empty):
            return answer.get(timeout=ANSWER_S)
        if claim.acquire(blocking=False):
            return f"{asked.what}: was not looked at within {ANSWER_S:g} s"
        with suppress(queue.Empty):
            return answer.get(timeout=ANSWER_S)
        return (
            f"{asked.what}: was begun, but not answered within {2 * ANSWER_S:g} s; look at the ram"
        )

    def beats(self) -> list[float | None]:
        """Return the heartbeats since the last call, with their senders' times in ms."""
        with self._lock:
            beats, self._beats = self._beats, []
        return beats

    def take(self) -> "Waiting | None":
        """Return the next command; None without one.

        One whose giver was told that it was not looked at is dropped, as nobody must be surprised
        by it.
        """
        while not self._waiting.empty():
            claim, waiting = self._waiting.get()
            if claim.acquire(blocking=False):
                return waiting
        return None


class Manual:
    """A manual session on a rig that is connected.

    Args:
        rig: the connected rig; whoever connected it leaves it.
        inbox: takes the commands.
        say: shows a line to whoever commands.
        tells: is called with what moves the ram, empty while it rests, and with how the motion
            before it has ended.
    """

    def __init__(
        self,
        rig: ConnectedRig,
        inbox: Inbox,
        say: Callable[[str], None],
        tells: Callable[[str, str], None] = lambda moves, moved: None,
    ) -> None:
        self._rig, self._inbox, self._say, self._tells = rig, inbox, say, tells
        self._bounds = bounds_of(rig.configured, rig.model)
        self._live: Live | None = None
        self._ended = self._remote = False
        self._moving = ""
        self._holds, self._ending = False, DONE
        self._quickest_s = float("inf")
        self._bypass, self._shown_at = "", 0.0

    @property
    def ended(self) -> bool:
        """Whether somebody asked for the end."""
        return self._ended

    @property
    def rests(self) -> bool:
        """Whether the ram rests, and nothing moves it."""
        is_moving = self._live is not None and not self._live.planner.rests
        return not is_moving and self._rig.state is not State.RUNNING

    def run(self, until: Callable[[], bool]) -> None:
        """Obey commands until `until` returns True, or one asks for the end.

        Raises:
            TripError: the rig tripped, or somebody asked to stop.
        """
        self._inbox.busy = ""
        while not self._ended and not until():
            begun = time.monotonic()
            self._rig.check()
            self._take_beats()
            while (item := self._inbox.take()) is not None:
                self._obey(*item)
            self._check_remote()
            self._turn()
            time.sleep(max(TURN_S - (time.monotonic() - begun), 1e-3))

    def _obey(self, asked: Asked, who: str, remote: bool, answer: "queue.SimpleQueue[str]") -> None:
        long = {"pump": self._pump, "home": self._home}
        try:
            if asked.what in long:
                self._check_long(asked)
                self._inbox.busy = f"the rig is busy: {asked.what} {asked.which}".rstrip()
            else:
                _QUICK[asked.what](self, asked)
        except ManualError as error:
            answer.put(str(error))
            return
        answer.put("")
        if asked.what not in ("show", "help"):
            self._remote = remote
            self._rig.note(who, " ".join(filter(None, (asked.what, asked.which))))
        if asked.what in long:
            long[asked.what](asked)
            self._inbox.busy = ""
            self._inbox.heard_at = time.monotonic()

    def _check_long(self, asked: Asked) -> None:
        if not self.rests:
            raise ManualError(f"{asked.what}: the ram moves ({self._moving}); stop it first")
        state = self._rig.state
        if asked.what == "home" and state is not State.NOT_HOMED:
            known = "the rig is homed" if state in _HOMED else "the pump is unloaded"
            remedy = "nothing is to do" if state in _HOMED else "ask for `pump high` first"
            raise ManualError(f"home: {known}; {remedy}")
        if asked.which == "low":
            raise ManualError(
                "pump: low is not possible, as its driver can load and unload the pump only; ask "
                "for high or unloaded"
            )
        if asked.which == "high" and state is not State.DISARMED:
            raise ManualError("pump: it is loaded already; ask for `pump unloaded` to unload it")

    def _pump(self, asked: Asked) -> None:
        rig = self._rig
        if asked.which == "unloaded":
            self._live = None
            rig.ramp_down()
            failures = rig.ask(rig.parts.field, MakeSafe(), SAFE_S)
            for part, why in failures.items():
                self._say(f"{part}: not safe: {why}; look at the rig before going near it")
            self._say("pump unloaded, bypasses shut, valve at null and disabled")
            return
        # An earlier ramp down, which disarmed the valve, is over.
        rig.board.words[Word.STOP] = Action.NONE
        arm(rig)
        self._say("pump loaded, valve enabled" + ("" if rig.state is State.ARMED else "; home now"))

    def _home(self, _: Asked) -> None:
        home(self._rig)
        bounds = self._bounds
        self._say(f"may move from {show(bounds.low_m, 'm')} to {show(bounds.high_m, 'm')}")

    def _ready(self, what: str) -> Live:
        """Return the segment in which the ram can be moved, which is begun if needed.

        Raises:
            ManualError: the rig is not homed or may not move now.
        """
        rig = self._rig
        if rig.state not in _HOMED:
            remedy = "`home`" if rig.state is State.NOT_HOMED else "`pump high`, then `home`"
            raise ManualError(f"{what}: the position is not known; ask for {remedy} first")
        words = rig.board.words
        if rig.state is State.HOLDING:
            if words[Word.ACTION] >= Action.HOLD:
                sentence, remedy = explain(Cause(int(words[Word.ACTION_CAUSE])))
                raise ManualError(f"{what}: {sentence}; {remedy}")
            rig.handle(Event.RELEASE)
        worn = self._live is not None and self._live.planner.rests and self._live.ticks_left < 3e5
        if self._live is None or worn:
            self._live = Live(rig, self._bounds)
        return self._live

    def _begin(self, moving: str) -> None:
        self._moving, self._holds, self._ending = moving, False, DONE
        self._tells(moving, "")
        if self._rig.state is State.ARMED:
            self._rig.handle(Event.RUN)

    def _speed(self, asked: Asked, most: float | None = None) -> float:
        speed = asked.numbers.get("speed", USUAL_SPEED)
        self._bounds.check_speed(speed, f"{asked.what} speed", most)
        return speed

    def _go(self, asked: Asked) -> None:
        assert asked.value is not None
        speed, live = self._speed(asked), self._ready(asked.what)
        target = asked.value
        if asked.what == "by":
            if not live.planner.rests:
                raise ManualError(f"by: the ram moves ({self._moving}); stop it first")
            target += live.planner.position_m
        self._bounds.check_position(target, asked.what)
        self._refuse_generator(live, asked.what)
        live.planner.go(target, speed)
        self._begin(f"{asked.what} {show(asked.value, 'm')}")

    def _hold(self, asked: Asked) -> None:
        speed, live = self._speed(asked, HOLD_SPEED), self._ready("hold")
        self._refuse_generator(live, "hold")
        end = self._bounds.high_m if asked.which == "out" else self._bounds.low_m
        if DIRECTIONS[asked.which] * (end - live.planner.position_m) < 1e-6:
            raise ManualError(f"hold: the ram is at {show(end, 'm')}, its limit; go the other way")
        if live.planner.rests:
            live.planner.caught_up(live.place)
        live.planner.go(end, speed, live.place + round(ALIVE_S / TICK))
        self._begin(f"hold {asked.which}")
        self._holds, self._quickest_s = True, float("inf")
        self._inbox.beats()

    def _take_beats(self) -> None:
        now, live, counts = time.monotonic(), self._live, False
        for sent_ms in self._inbox.beats():
            late_s = now - (now if sent_ms is None else 1e-3 * sent_ms)
            if sent_ms is not None:
                self._quickest_s = min(self._quickest_s, late_s)
                counts = counts or late_s - self._quickest_s <= LATE_S
            else:
                counts = True
        if counts and self._holds and live is not None:
            live.planner.alive_until(live.place + round(ALIVE_S / TICK))

    def _stop(self, _: Asked) -> None:
        if self._live is None:
            return
        if self._holds or not self._live.planner.rests:
            self._ending = "brought to rest"
        self._holds = False
        self._live.planner.halt()

    def _generate(self, asked: Asked) -> None:
        numbers, live = asked.numbers, self._ready("generator")
        running = live.planner.generator
        if running is None:
            if not live.planner.rests:
                if self._moving.startswith("generator"):
                    raise ManualError(
                        "generator: the ram is on its way to the wave's mean, or comes to rest "
                        "after the wave; wait until it is there"
                    )
                raise ManualError(f"generator: the ram moves ({self._moving}); stop it first")
            missing = {"amplitude", "frequency"} - set(numbers)
            if not asked.which or missing:
                lacks = ", ".join(sorted(missing)) or "its shape"
                raise ManualError(
                    f"generator: {lacks} is missing; write `generator sine mean 300mm amplitude "
                    "20mm frequency 0.5Hz`"
                )
            mean = numbers.get("mean", live.planner.position_m)
            before = Wave(asked.which, mean, 0.0, numbers["frequency"], numbers["frequency"])
            wave = _changed(before, numbers)
            check_change(wave.at_rest, wave, self._bounds)
            live.planner.generate(lambda: Generator(wave, self._bounds), mean, USUAL_SPEED)
            self._begin(f"generator {asked.which}")
        else:
            before = running.wanted
            if asked.which and asked.which != before.shape:
                before = replace(before, shape=asked.which)
            running.change(_changed(before, numbers))

    def _refuse_generator(self, live: Live, what: str) -> None:
        if live.planner.generator is not None:
            raise ManualError(f"{what}: the generator runs; stop it first")

    def _set_bypass(self, asked: Asked) -> None:
        rig, kind = self._rig, asked.which
        if kind not in rig.configured.injectable:
            known = ", ".join(rig.configured.injectable) or "none"
            raise ManualError(f"bypass: {kind} is none that this rig moves; it has {known}")
        if rig.state not in _HOMED:
            raise ManualError("bypass: the rig is not homed; ask for `pump high`, then `home`")
        output = f"{kind}_needle" if asked.ball is None else f"{kind}_ball"
        if rig.off({output: 2.0}) != [output]:
            raise ManualError(f"bypass: {kind} has no ball valve; give an opening, such as 30%")
        rig.write({output: float(bool(asked.ball)) if asked.value is None else asked.value})
        self._bypass, self._shown_at = kind, time.monotonic() + 3.0

    def _show(self, _: Asked) -> None:
        rig = self._rig
        position, setpoint = rig.latest("position_m"), rig.latest("setpoint_m")
        homed = "" if rig.state in _HOMED else ", not homed"
        doing = "" if self.rests else f", {self._moving}"
        places = f"ram {1e3 * position:.2f} mm, setpoint {1e3 * setpoint:.2f} mm"
        volts = rig.latest("device_command_V")
        self._say(f"{rig.state.value}{homed}{doing}: {places}, command {volts:.3f} V")
        loaded = {1.0: "loaded", 0.0: "unloaded"}.get(rig.slow("pump_loaded"), "not known")
        self._say(f"pump {loaded}, {1e-6 * rig.slow('pump_pressure_Pa'):.2f} MPa")
        for kind in rig.configured.injectable:
            self._say(self.bypass_line(kind))

    def bypass_line(self, kind: str) -> str:
        """Return a bypass's ball, needle and meter in words, as they were read last."""
        rig = self._rig
        ball = {1.0: "open, ", 0.0: "shut, "}.get(rig.slow(f"{kind}_ball"), "")
        needle = f"needle {100.0 * rig.slow(f'{kind}_needle'):.0f} %"
        if kind not in WAYS:
            return f"{kind}: {ball}{needle}, no meter"
        return f"{kind}: {ball}{needle}, meter {6e4 * rig.latest(WAYS[kind].meter):.3f} L/min"

    def _help(self, _: Asked) -> None:
        for line in HELP.splitlines():
            self._say(line)

    def _end(self, _: Asked) -> None:
        self._ended = True

    def _check_remote(self) -> None:
        """End the session if the page that moves the ram is lost.

        Raises:
            StopRequestedError: it is.
        """
        silent = time.monotonic() - self._inbox.heard_at > REMOTE_S
        if self._remote and silent and not self.rests:
            raise StopRequestedError(
                f"stopped: the page by which the ram was moved is silent for {REMOTE_S:g} s"
            )

    def _turn(self) -> None:
        live, rig = self._live, self._rig
        if self._bypass and time.monotonic() > self._shown_at:
            self._say(self.bypass_line(self._bypass))
            self._bypass = ""
        if live is None:
            return
        if live.stopped:
            self._held()
            return
        if live.ticks_left < 0 and not live.planner.rests:
            self._wear(live)
        if live.turn():
            self._ending = "broken off, as this computer was too busy"
        if live.planner.rests and rig.state is State.RUNNING:
            # The last stretch is laid out, and the ram has still to follow it.
            if live.place < live.planner.place + SETTLING_TICKS:
                return
            rig.handle(Event.DONE)
            if self._holds and live.planner.position_m not in (
                self._bounds.low_m,
                self._bounds.high_m,
            ):
                self._ending = "ended, as no heartbeat came in time"
            self._holds = False
            self._end_motion(
                f"{self._ending}, the ram is at {1e3 * rig.latest('position_m'):.2f} mm"
            )

    def _end_motion(self, how: str) -> None:
        moved = f"{self._moving or 'the ram'}: {how}"
        self._say(moved)
        self._tells("", moved)

    def _wear(self, live: Live) -> None:
        """Bring a motion to rest whose segment is nearly at its end."""
        generator = live.planner.generator
        if generator is None:
            live.planner.halt()
        elif generator.wanted.amplitude_m:
            generator.change(generator.wanted.at_rest)
            self._ending = "ended after ten minutes"

    def _held(self) -> None:
        """Hold the ram in a segment of its own after the loop has ended the motion for a limit."""
        rig, words = self._rig, self._rig.board.words
        cause = Cause(int(words[Word.ACTION_CAUSE]))
        self._live = None
        if words[Word.ACTION] == Action.HOLD:
            rig.handle(Event.HOLD)
            rig.switch_to(Drive.HOLD)
        else:
            rig.ramp_down()
        sentence, remedy = explain(cause, loop_channel(rig.board))
        self._end_motion(f"held: {sentence}; {remedy}")


def _changed(wave: Wave, numbers: Mapping[str, float]) -> Wave:
    """Return a wave with other quantities, by the words of the commands."""
    frequency = numbers.get("frequency", wave.frequency_hz)
    upto = wave.to_hz if wave.shape == "chirp" else frequency
    return replace(
        wave,
        mean_m=numbers.get("mean", wave.mean_m),
        amplitude_m=numbers.get("amplitude", wave.amplitude_m),
        frequency_hz=frequency,
        to_hz=numbers.get("upto", upto) if wave.shape == "chirp" else frequency,
        sweep_s=numbers.get("sweep", wave.sweep_s or SWEEP_S),
    )


_QUICK: Final[dict[str, Callable[[Manual, Asked], None]]] = {
    "by": Manual._go,
    "to": Manual._go,
    "hold": Manual._hold,
    "stop": Manual._stop,
    "generator": Manual._generate,
    "bypass": Manual._set_bypass,
    "show": Manual._show,
    "help": Manual._help,
    "end": Manual._end,
}
