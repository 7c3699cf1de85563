"""A stand-in for a session's supervisor with a live stream, for tests of the publisher."""

from pathlib import Path

from rig.loop.board import RING_ROWS, Board, Word
from rig.stream.commands import Command, make_key, read_key
from rig.stream.settings import Endpoint, Operator, StreamSettings
from rig.supervisor.processes.streaming import Stream

CHANNELS = ("time_s", "position_m", "wakeup_s", "segment")


class Bench:
    """A board and a live stream, as a session's supervisor has them.

    Attributes:
        key: the signing key of the operator ann, who may abort and hold.
        said: messages that the publisher reported.
        commands: commands that operators sent.
        refusal: answer to each command; "" accepts it.
    """

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        key = folder / "ann.key"
        make_key(key)
        self.key = read_key(key)
        self.settings = StreamSettings(
            listen=(Endpoint("tcp", "127.0.0.1", port),),
            operators=(Operator("ann", ("abort", "hold"), key),),
            history_s=10.0,
            heartbeat_s=0.1,
        )
        self.said: list[str] = []
        self.commands: list[Command] = []
        self.refusal = ""
        self.board = Board.create(len(CHANNELS))
        self.board.words[Word.HOMED] = 1
        self.stream = Stream(
            self.settings, "bench", folder / "log", self.said.append, self.on_command
        )

    def on_command(self, command: Command) -> str:
        self.commands.append(command)
        return self.refusal

    def write(self, count: int, segment: int = 1) -> None:
        """Write `count` rows of a segment to the ring, as the loop does."""
        for _ in range(count):
            at = int(self.board.words[Word.ROWS])
            self.board.ring[at % RING_ROWS] = (1e-3 * at, at, 2e-5, segment)
            self.board.words[Word.ROWS] = at + 1

    @property
    def pid(self) -> int | None:
        """The process id of the publisher; None while no publisher works."""
        child = self.stream._child
        return None if child is None else child._process.pid

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()
