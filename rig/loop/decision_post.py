"""Posts decisions on the board for the loop in another process, which never waits for them.

Decisions have a ring of their own. A decision is written before the word that counts it
(`store_release`). The loop copies the newest decision, and then checks by the count whether its
place can have been written again meanwhile, which takes seconds. If so, the loop ignores the copy
and tries again at the next tick.
"""

import numpy as np
from numpy.typing import NDArray

from .atomic import store_release
from .board import DECISIONS_KEPT, Board, Word

Array = NDArray[np.float64]


class DecisionPost:
    """The supervisor's side, which writes decisions on the board."""

    def __init__(self, board: Board) -> None:
        self._words, self._decisions = board.words, board.decisions

    def post(self, segment: int, row: Array) -> None:
        """Post a decision on a segment, a row of `DECIDED`; other segments ignore it."""
        number = int(self._words[Word.DECISIONS]) + 1
        place = self._decisions[number % DECISIONS_KEPT]
        place[0], place[1:] = segment, row
        store_release(self._words, Word.DECISIONS.value, number)


def prepare() -> None:
    """Compile the function that `post` needs, before a session begins."""
    store_release(np.zeros(1, np.int64), 0, 0)
