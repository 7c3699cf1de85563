"""A station reads its rig while nothing drives it, and lends it to who asks."""

import gc
import os
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any, Final, Protocol

from estimator.filters import DEFAULT_FILTER
from rig.channels import BYPASSES
from rig.configuration import Rig
from rig.heap import give_back
from rig.io import DriverError, in_use
from rig.loop import Board, TripError
from rig.plant import Model
from rig.runner.campaign import WITHOUT_TESTS, Needs, StopFlag, compile_for, is_compiled
from rig.supervisor import LOG, ConnectedRig, Keeper, Lease, MakeSafe, Onlooker

from .last_use import LastUse
from .station_log import StationLog, keep_newest

WATCH: Final = "idle: the station reads, nothing drives"
"""What a station tells the live stream that it does."""
COMPILES: Final = "its program is compiled for this machine; nothing drives"
"""What a station tells whoever asks for its state meanwhile."""
COMPILED: Final = "the station's program is compiled; it opens the devices now"
NOTHING_MOVES: Final = "nothing moves; the rig is disarmed"
"""Why a station does not obey a command, not even a stop."""
AGAIN_S: Final = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Times in s before the devices are tried again, after the first, second, ... failure in a row.

The last one is that of all further failures. It is as long as the live stream waits before its
publisher is started again, and short beside the time in which somebody plugs in a device.
"""
WORKED_S: Final = 60.0
"""Time in s of an idle session after which its failure counts as the first again."""
POLL_S: Final = 0.1
"""Period in s at which an idle session is looked after; the safety thread allows 5 s."""
SAFE_S: Final = 20.0
"""Time in s within which slow drivers must reach their safe state."""
FOUND_S: Final = 2.0
"""Time in s within which every device is read, so that it can be told how the rig was found."""

Obey = Callable[[Any], str]
"""Takes a command of the live stream; returns why it is not obeyed, or "" if it is."""
Watched = Callable[[Obey], AbstractContextManager[tuple[Callable[[str], None], Onlooker]]]
"""Opens the live stream of an idle session, whose commands it hands on; the context gives a
function that shows a line, here and there, and the session's onlooker."""


class Session(Protocol):
    """What a station needs of a `ConnectedRig`; tests replace it."""

    parts: Any

    def connect(self) -> None:
        """Connect; see `ConnectedRig.connect`."""

    def going_on(self) -> None:
        """Raise a `TripError` after a trip; see `ConnectedRig.going_on`."""

    def leave(self) -> None:
        """Leave the rig safe; see `ConnectedRig.leave`."""

    def latest(self, channel: str) -> float:
        """Return a column's newest value; see `ConnectedRig.latest`."""

    def slow(self, channel: str) -> float:
        """Return a slow channel's newest value; see `ConnectedRig.slow`."""

    def ask(self, part: Any, order: object, timeout_s: float) -> Any:
        """Send an order to a part; see `ConnectedRig.ask`."""


@dataclass(frozen=True)
class Yielding:
    """A flag by which an idle session ends: the station is to end, or somebody asks for the rig.

    Attributes:
        stop: the flag of the station itself.
        keeper: keeps the leases.
    """

    stop: StopFlag
    keeper: Keeper

    @property
    def requested(self) -> bool:
        """Whether the idle session is to end."""
        return self.stop.requested or self.keeper.asked is not None

    @property
    def reason(self) -> str:
        """Who or what asked for that."""
        lease = self.keeper.asked
        return self.stop.reason or ("" if lease is None else f"{lease.what}, asked by {lease.by}")


class Resident:
    """A station of a rig, which runs until it is asked to end.

    Args:
        rig: the rig, on hardware.
        model: the model that is assumed of the rig.
        folder: the station's folder, which exists.
        keeper: keeps the leases; its context has been entered.
        stop: the flag by which the station is asked to end.
        log: takes what happens.
        watched: opens the live stream of an idle session.
        make: makes a session of the arguments of `ConnectedRig`.
    """

    def __init__(
        self,
        rig: Rig,
        model: Model,
        folder: Path,
        keeper: Keeper,
        stop: StopFlag,
        log: StationLog,
        watched: Watched,
        make: Callable[..., Session] = ConnectedRig,
    ) -> None:
        self._rig = rig
        self._model = model
        self._folder = folder
        self._keeper = keeper
        self._stop = stop
        self._log = log
        self._watched = watched
        self._make = make
        self._failures = 0
        self._lost = ""
        self._unsafe = ""
        self._last = LastUse(folder, lambda line: log.write("last", line))
        self._lent: Lease | None = None
        """Who had the rig last, and may still say how that ended."""
        self._onlooker = Onlooker()
        """The onlooker of the present idle session, or of the last one."""
        keeper.heard = self._tell_end

    def run(self) -> None:
        """Read the rig and lend it, until the station is asked to end; then leave it safe.

        Raises:
            TripError: a device was not confirmed safe in the end.
        """
        self._log.write("started", f"station of {self._rig.name} started")
        while not self._stop.requested:
            if self._keeper.asked is not None:
                self._lend(self._keeper.asked)
            else:
                self._idle()
                # The objects of a session that has ended refer to one another, and to the memory
                # that its processes shared, which would stay mapped for dozens of sessions more.
                gc.collect()
                give_back()
        self._log.write("ended", f"station of {self._rig.name} ended by {self._stop.reason}")
        if self._unsafe:
            raise TripError(self._unsafe)

    def _lend(self, lease: Lease) -> None:
        """Leave the rig to a client until its lease ends, or the station is to end."""
        if self._unsafe:
            problem, self._unsafe = self._unsafe, ""
            self._keeper.refuse(lease, problem, "look at the rig before going near it")
            self._log.write("refused", f"{lease.what}, asked by {lease.by}, not begun: {problem}")
            return
        if not self._keeper.grant(lease):
            return
        self._log.write("lent", f"{lease.what}, asked by {lease.by}, drives (process {lease.pid})")
        self._lent = lease
        self._last.lent(lease)
        while self._keeper.holds(lease) and not self._stop.requested:
            self._keeper.changed.wait(POLL_S)
            self._keeper.changed.clear()
        self._failures = 0
        if self._keeper.holds(lease):
            self._log.write("left", f"{lease.what}, asked by {lease.by}, goes on by itself")
        elif lease.said_end:
            self._log.write("returned", f"{lease.what}, asked by {lease.by}, has ended")
        else:
            text = f"{lease.what}, asked by {lease.by}, ended without a word: its process died"
            self._log.write("died", text)
        self._tell_end()

    def _tell_end(self) -> None:
        """Keep how the last use of the rig has ended, if that was told; tell the onlooker of it."""
        lease = self._lent
        if lease is not None and not self._keeper.holds(lease):
            self._last.ended(lease)
        if self._last.look():
            self._onlooker.came_before(self._last.content)

    def _idle(self) -> None:
        """Read the rig until somebody asks for it, the station is to end, or something fails."""
        started = time.monotonic()
        try:
            keep_newest(self._folder, LOG)
            self._compile()
            if Yielding(self._stop, self._keeper).requested:
                return
            with self._watched(self._obey) as (say, onlooker):
                self._read(say, onlooker)
        except (DriverError, TripError, OSError) as error:
            if Yielding(self._stop, self._keeper).requested:
                return
            self._failures = 1 if time.monotonic() - started > WORKED_S else self._failures + 1
            wait_s = AGAIN_S[min(self._failures, len(AGAIN_S)) - 1]
            self._tell_lost(str(error) or type(error).__name__)
            self._keeper.changed.clear()
            until = time.monotonic() + wait_s
            while not Yielding(self._stop, self._keeper).requested and time.monotonic() < until:
                self._keeper.changed.wait(POLL_S)

    def _compile(self) -> None:
        """Compile what an idle session runs, if that is not done, and let the live stream tell it.

        The rig is lent meanwhile, which ends the compiling; its client has compiled what it needs.
        """
        needs, yielding = Needs(self._rig, DEFAULT_FILTER), Yielding(self._stop, self._keeper)
        if is_compiled(needs, WITHOUT_TESTS):
            return
        self._keeper.stands("no devices", COMPILES)
        if in_use(self._rig.drivers):
            # Who has the devices speaks in the rig's name on the stream.
            compile_for(needs, WITHOUT_TESTS, partial(self._log.write, "told"), yielding)
            return
        with self._watched(self._obey) as (say, onlooker):

            def told(text: str) -> None:
                self._log.write("told", text)
                say(text)

            self._onlooker = onlooker
            # There are no rows before there is a session.
            board = Board.create(1)
            try:
                onlooker.connects(board, ("segment",))
                onlooker.came_before(self._last.content)
                onlooker.compiles(", ".join(WITHOUT_TESTS))
                compile_for(needs, WITHOUT_TESTS, told, yielding)
            finally:
                os.close(board.fd)
            if self._keeper.asked is not None:
                onlooker.hands_over(yielding.reason)
            elif not self._stop.requested:
                onlooker.ends_for(COMPILED)

    def _tell_lost(self, why: str) -> None:
        """Keep why the rig cannot be read now, unless that was the last thing that was kept."""
        self._keeper.stands("no devices", f"the rig cannot be read: {why}; tried again")
        if why != self._lost:
            self._log.write("lost", f"the rig cannot be read: {why}; tried again until it can")
        self._lost = why

    def _read(self, say: Callable[[str], None], onlooker: Onlooker) -> None:
        """Connect, make sure that the rig is safe, and read it; leave it safe in the end.

        Raises:
            DriverError: a device does not answer, is not the configured one, or is in use.
            TripError: the rig has tripped, could not be connected, or a device is not safe.
        """
        yielding = Yielding(self._stop, self._keeper)

        def told(text: str) -> None:
            self._log.write("told", text)
            say(text)

        session = self._make(
            self._rig, DEFAULT_FILTER, self._model, self._folder, yielding, told, onlooker,
            lambda text: self._log.write("driven by another master", text),
        )  # fmt: skip
        self._onlooker = onlooker
        onlooker.came_before(self._last.content)
        session.connect()
        tripped: TripError | None = None
        try:
            found = as_found(session, self._rig)
            unsafe: Mapping[str, str] = session.ask(session.parts.field, MakeSafe(), SAFE_S)
            text = "; ".join([f"the rig is read; found {found}", *map(_unsafe, unsafe.items())])
            self._log.write("found", text)
            say(text)
            self._lost, self._unsafe = "", ""
            self._keeper.stands("idle", f"{WATCH}; found {found}")
            while not yielding.requested:
                session.going_on()
                self._tell_end()
                self._keeper.changed.wait(POLL_S)
                self._keeper.changed.clear()
            if not self._stop.requested:
                onlooker.hands_over(yielding.reason)
        except TripError as error:
            tripped = error
            raise
        finally:
            self._leave(session, tripped)

    def _leave(self, session: Session, tripped: TripError | None) -> None:
        """Leave the rig; keep why a device could not be confirmed safe, for who asks for the rig.

        Raises:
            TripError: a device is not safe, or a trip was not reported yet.
        """
        try:
            session.leave()
        except TripError as error:
            self._unsafe = str(error)
            self._log.write("unsafe", str(error))
            if tripped is None:
                raise

    def _obey(self, command: Any) -> str:
        """Refuse a command, as nothing moves; a stop ends what is about to begin.

        That somebody has seen how the last use of the rig ended is kept.
        """
        if command.name == "acknowledge":
            refused = self._last.acknowledge(command.by, command.person, command.text)
            if not refused:
                who = command.person or command.by
                self._log.write("acknowledged", f"{who} has seen how {self._last.name} ended")
                self._tell_end()
            return refused
        lease = self._keeper.asked
        if command.name != "abort" or lease is None:
            return NOTHING_MOVES
        who = command.person or command.by
        self._keeper.refuse(lease, f"stopped by {who} before it began", "ask again")
        self._log.write("stopped", f"{lease.what}, asked by {lease.by}, stopped by {who}")
        return ""


def _unsafe(item: tuple[str, str]) -> str:
    return f"{item[0]}: not safe: {item[1]}"


def as_found(session: Session, rig: Rig) -> str:
    """Return how a rig stands by what its devices answer, in words; wait for the answers."""
    names = [f"{kind}_ball" for kind in BYPASSES]
    read = {name for spec in rig.drivers for name in spec.inputs}
    fitted = [name for name in (*names, "pump_loaded") if name in read]
    until = time.monotonic() + FOUND_S
    while time.monotonic() < until:
        session.going_on()
        values = {name: session.slow(name) for name in fitted}
        enabled, command = session.latest("valve_enabled"), session.latest("device_command_V")
        if not any(map(isnan, (*values.values(), enabled, command))):
            break
        time.sleep(POLL_S)
    said = [_word(enabled, "valve disabled", "valve ENABLED")]
    said.append("command not read" if isnan(command) else f"command {command:.2f} V")
    said += [_word(values[name], "", f"{name[:-5]} OPEN") for name in fitted if name in names]
    if said[2:] and not any(said[2:]):
        said[2:] = ["bypasses shut"]
    if "pump_loaded" in fitted:
        said.append(_word(values["pump_loaded"], "pump unloaded", "pump LOADED"))
    return ", ".join(word for word in said if word)


def _word(value: float, if_zero: str, else_: str) -> str:
    if isnan(value):
        return f"{else_.split()[0]} not read"
    return if_zero if value == 0.0 else else_
