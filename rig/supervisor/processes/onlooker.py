"""The base class of objects that a session informs of its progress; nothing depends on them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.loop import Board


class Errand(NamedTuple):
    """What a session wants the rig for.

    Attributes:
        what: what is done with the rig, such as "homing"; empty if that is not known.
        by: name of who asked for it; empty if that is not known.
        of_station: whether it is the station itself that reads the rig, which asks no other program
            for it.
    """

    what: str = ""
    by: str = ""
    of_station: bool = False


class Onlooker:
    """An observer of a session on hardware, whose methods do nothing; override them as needed.

    The session itself calls the methods, and waits for them to return.
    """

    @property
    def errand(self) -> Errand:
        """What the session wants the rig for; a station is told this when it is asked for it."""
        return Errand()

    def connects(self, board: Board, channels: tuple[str, ...]) -> None:
        """Learn that the session connects its devices, and of its board and its rows' columns.

        No device is open yet; a stop that is asked for from now on ends the connecting.
        """

    def came_to(self, state: str) -> None:
        """Learn the session's new state."""

    def compiles(self, what: str) -> None:
        """Learn what is compiled for the session, before a device is open; empty once it is."""

    def moves(self, motion: str, moved: str) -> None:
        """Learn which motion by hand has begun, and how the one before it ended, in words.

        Either is empty if there is none.
        """

    def came_before(self, last: Mapping[str, Any]) -> None:
        """Learn what drove the rig last, how that ended and who saw it; a station tells this."""

    def hands_over(self, to: str) -> None:
        """Learn that the session, of a station, ends now to leave the rig to who has asked for it.

        `to` says what for and who, as in "homing, asked by Bo".
        """

    def ends_for(self, reason: str) -> None:
        """Learn why the session, of a station, ends now; the station itself goes on."""
