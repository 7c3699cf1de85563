"""Refuses an order, request, message or file of which a key comes twice.

JSON and MessagePack let a key come again, and their readers take the last value silently. Who
checks an order and who obeys it could then read different ones, and a file would not mean what its
reader sees first.
"""

import json
import re
from collections.abc import Iterable
from typing import Any, Final

_LONGEST_SHOWN: Final = 40
"""Most characters of a key that the message shows."""
_MOST_DIGITS: Final = 100
"""Most digits of a whole number in a JSON text. One of more than 308 is beyond
every float, and Python's have no end."""
_MARKS: Final = re.compile(r'("[^"\\]*(?:\\.[^"\\]*)*")(\s*:)?|[{}]')
"""The strings of a JSON text, those that are keys with their colon, and the ends of its objects."""


class RepeatedKeyError(ValueError):
    """Raised for a map in which a key comes twice; its message names the key."""


class RepeatedLineError(RepeatedKeyError):
    """Raised for a JSON text in which a key comes twice.

    Attributes:
        line: number of the line in which it comes for the second time, from 1.
    """

    def __init__(self, key: str, first: int, line: int) -> None:
        self.line = line
        shown = f"{key[:_LONGEST_SHOWN]!a}"
        super().__init__(f"{shown} is given twice, first in line {first}; keep one")

    def at(self, path: object) -> str:
        """Return the message with a file's path and the line in front."""
        return f"{path}:{self.line}: {self}"


def unique_keys(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """Return pairs of key and value as a dict; `object_pairs_hook` of a reader.

    Raises:
        RepeatedKeyError: a key comes twice.
    """
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if key in found:
            raise RepeatedKeyError(f"has the key {str(key)[:_LONGEST_SHOWN]!a} twice")
        found[key] = value
    return found


def json_of(text: str | bytes) -> Any:
    """Return the value of a JSON text.

    Raises:
        RepeatedLineError: a key comes twice in an object.
        ValueError: the text is no JSON, or has a whole number of more than 100 digits.
        RecursionError: it is nested too deeply.
    """
    try:
        return json.loads(text, object_pairs_hook=unique_keys, parse_int=_whole)
    except RepeatedKeyError:
        if isinstance(text, bytes):
            text = text.decode(json.detect_encoding(text), "surrogatepass")
        raise _first_repetition(text) from None


def _whole(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"has a whole number of {len(digits)} digits")
    return int(digits)


def _first_repetition(text: str) -> RepeatedLineError:
    """Return the error of a JSON text in which a key comes twice in an object."""
    objects: list[dict[str, int]] = []
    for found in _MARKS.finditer(text):
        mark, place = found[0], found.start()
        if mark == "{":
            objects.append({})
        elif mark == "}":
            objects.pop()
        elif found[2]:
            key = json.loads(found[1])
            first = objects[-1].setdefault(key, place)
            if first != place:
                lines = (1 + text.count("\n", 0, at) for at in (first, place))
                return RepeatedLineError(key, *lines)
    raise AssertionError("no key comes twice")
