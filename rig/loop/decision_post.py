"""How a decision reaches the loop in another process: posted on the board, and never waited for.

Decisions stand in a ring of their own. One is written before the number that counts it
(`store_release`); the loop copies the newest and then sees by the number whether its place can have
been written again meanwhile, which takes seconds. It then goes without, until the next tick.
"""

import numpy as np
from numpy.typing import NDArray

from .atomic import store_release
from .board import DECISIONS_KEPT, Board, Word

Array = NDArray[np.float64]


class DecisionPost:
    """The supervisor's end."""

    def __init__(self, board: Board) -> None:
        self._words, self._decisions = board.words, board.decisions

    def post(self, segment: int, row: Array) -> None:
        """Post a row of `rig.loop.decided.DECIDED` on a segment; others' are ignored."""
        number = int(self._words[Word.DECISIONS]) + 1
        place = self._decisions[number % DECISIONS_KEPT]
        place[0], place[1:] = segment, row
        store_release(self._words, Word.DECISIONS.value, number)


def prepare() -> None:
    """Compile what posting needs, before time matters."""
    store_release(np.zeros(1, np.int64), 0, 0)
