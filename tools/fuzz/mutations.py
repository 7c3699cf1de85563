"""Changes inputs at random, without a guide, for the fixed set of inputs of `make test`."""

import random
from collections.abc import Callable
from typing import Final

_STRANGE: Final = (
    b"\x00", b"\xff", b"\xed\xa0\x80", b"-1", b"1e400", b"nan", b"9" * 30, b"{", b"[",
)  # fmt: skip
"""Bytes that readers stumble over: ends of ranges, a lone surrogate, numbers, open brackets."""


def mutated(data: bytes, draws: random.Random) -> bytes:
    """Return an input that differs from another one in one to four places.

    Args:
        data: the other input.
        draws: gives the places and the changes.
    """
    for _ in range(draws.randint(1, 4)):
        at = draws.randint(0, len(data))
        data = draws.choice(_CHANGES)(data, at, draws)
    return data


def _cut(data: bytes, at: int, draws: random.Random) -> bytes:
    return data[:at]


def _without(data: bytes, at: int, draws: random.Random) -> bytes:
    return data[:at] + data[at + draws.randint(1, 16) :]


def _flip(data: bytes, at: int, draws: random.Random) -> bytes:
    flipped = bytes(byte ^ 1 << draws.randrange(8) for byte in data[at : at + 1])
    return data[:at] + flipped + data[at + 1 :]


def _insert(data: bytes, at: int, draws: random.Random) -> bytes:
    return data[:at] + draws.choice(_STRANGE) + data[at:]


def _repeat(data: bytes, at: int, draws: random.Random) -> bytes:
    return data[:at] + data[at : at + draws.randint(1, 64)] * 2 + data[at:]


_CHANGES: Final[tuple[Callable[[bytes, int, random.Random], bytes], ...]] = (
    _cut, _without, _flip, _flip, _insert, _repeat,
)  # fmt: skip
