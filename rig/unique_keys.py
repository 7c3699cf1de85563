"""Refuses an order, request or message of which a key comes twice.

JSON and MessagePack let a key come again, and their readers take the last value without a word. Who
checks an order and who obeys it could then read different ones.
"""

from collections.abc import Iterable
from typing import Any, Final

_LONGEST_SHOWN: Final = 40
"""Most characters of a key that the message shows."""


class RepeatedKeyError(ValueError):
    """Raised for a map in which a key comes twice; its message names the key."""


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
