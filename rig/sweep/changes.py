"""Names what differs between two sweeps, so that a user knows why one is not the other resumed."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

_SAID: Final = {"sequence": "segments"}
"""Keys of a motion that the file calls otherwise."""
_NAMES: Final = {"criteria": "figure", "limits": "watched"}


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield what differs between the meanings of two sweeps, in words.

    Args:
        before: the meaning of the earlier sweep, as `Sweep.meaning` returns it.
        now: the meaning of the later one.
    """
    for key in (*now, *(key for key in before if key not in now)):
        if before.get(key) == now.get(key):
            continue
        if key == "motions":
            yield from _of_motions(before[key], now[key])
        else:
            yield key


def _of_motions(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> Iterator[str]:
    """Yield what differs between the motions of two sweeps, and in which motions if not in all."""
    if [each["name"] for each in before] != [each["name"] for each in now]:
        yield "the names or the order of motions"
        return
    where: dict[str, list[str]] = {}
    for old, new in zip(before, now, strict=True):
        for words in _of_motion(old, new):
            where.setdefault(words, []).append(new["name"])
    for words, names in where.items():
        yield words if len(names) == len(now) else f"{words} of the motion {', '.join(names)}"


def _of_motion(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for key in dict.fromkeys((*now, *before)):
        old: Any = before.get(key)
        new: Any = now.get(key)
        if old == new:
            continue
        if key == "values":
            yield from (each for each in {**old, **new} if old.get(each) != new.get(each))
        elif key in _NAMES:
            differing = [each for each in new or [] if each not in (old or [])]
            differing += [each for each in old or [] if each not in (new or [])]
            names = dict.fromkeys(each[_NAMES[key]] for each in differing)
            yield f"{key} on {', '.join(names)}" if names else f"order of {key}"
        else:
            yield _SAID.get(key, key)
