"""Health tells of a trip once the rig was read, and of none while it is only being connected."""

from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.supervisor.processes.health import Health, trip


def test_a_session_that_ends_as_it_connects_is_not_said_to_have_tripped() -> None:
    board = Board.create(3)
    health = Health(board, ("time_s", "tick", "position_m"))
    trip(board.words, "field", Cause.SUPERVISOR_LOST)
    assert health.content()["trips"] == {}
    board.words[Word.ROWS] = 1
    (first,) = health.content()["trips"]["first_out"]
    assert (first["by"], first["cause"]) == ("field", "SUPERVISOR_LOST")
