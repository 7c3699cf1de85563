"""The base class of objects that a session informs of its progress; nothing depends on them."""

from rig.loop import Board


class Onlooker:
    """An observer of a session on hardware, whose methods do nothing; override them as needed.

    The session itself calls the methods, and waits for them to return.
    """

    def connected(self, board: Board, channels: tuple[str, ...]) -> None:
        """Learn that the session is connected, with this board, whose rows have these columns."""

    def came_to(self, state: str) -> None:
        """Learn the session's new state."""
