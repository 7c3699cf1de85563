"""What a session reports to whoever looks on; nothing depends on it."""

from rig.loop import Board


class Onlooker:
    """Is called as a session on hardware goes on; does nothing. Derive, and override what you need.

    Calls come from the session itself, which waits for them to return.
    """

    def connected(self, board: Board, channels: tuple[str, ...]) -> None:
        """Take note of the shared memory, whose rows have these columns."""

    def came_to(self, state: str) -> None:
        """Take note of the session's new state."""
