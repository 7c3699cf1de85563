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


def post_decision(board: Board, segment: int, row: NDArray[np.float64]) -> None:
    """Post a decision on a segment, a row of `DECIDED`; other segments ignore it."""
    number = int(board.words[Word.DECISIONS]) + 1
    place = board.decisions[number % DECISIONS_KEPT]
    place[0], place[1:] = segment, row
    store_release(board.words, Word.DECISIONS.value, number)
