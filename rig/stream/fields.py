"""These checks are the one place where the content of received messages is checked, by kind.

Any publisher on a rig's keys can publish anything. A message that passes has values of the types
that docs/stream.md gives, and nothing that cannot be shown, computed with, or written as JSON: no
infinity, no number beyond 64 bits, no deep nesting. An unknown key may come from a newer publisher;
it passes if its value is plain (`is_plain`).
"""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, Final

Check = Callable[[Any], bool]

DEEPEST: Final = 8
"""Most levels of maps and lists within each other; a trip in `health` has four."""
MOST_ROWS: Final = 1 << 62
"""Counts must be below this, so that a row's number plus a batch's length fits into 64 bits."""
LONGEST_HEARTBEAT_S: Final = 10.0
"""Longest time in s between heartbeats that a profile may set (`rig.configuration.rigs.stream`)."""


def is_text(value: Any) -> bool:
    """Return whether a value is a text."""
    return type(value) is str


def is_truth(value: Any) -> bool:
    """Return whether a value is true or false."""
    return type(value) is bool


def is_packed(value: Any) -> bool:
    """Return whether a value is bytes."""
    return type(value) is bytes


def is_whole(value: Any) -> bool:
    """Return whether a value is an integer that fits a signed 64-bit number."""
    return type(value) is int and -(1 << 63) <= value < 1 << 63


def is_count(value: Any) -> bool:
    """Return whether a value is an integer from 0 to below `MOST_ROWS`."""
    return type(value) is int and 0 <= value < MOST_ROWS


def is_number(value: Any) -> bool:
    """Return whether a value is a finite float, a 64-bit integer or None, which means not known."""
    return value is None or is_whole(value) or (type(value) is float and isfinite(value))


def is_period(value: Any) -> bool:
    """Return whether a value is a possible time between heartbeats: above 0, at most 10 s."""
    return type(value) in (int, float) and 0.0 < value <= LONGEST_HEARTBEAT_S


def is_plain(value: Any, depth: int = DEEPEST) -> bool:
    """Return whether a value is text, boolean, number or None, or a map or list of such values.

    A number must be finite and fit 64 bits, the keys of a map must be texts, and maps and lists may
    be nested `depth` levels deep.
    """
    if type(value) is dict:
        return depth > 0 and all(is_text(k) and is_plain(v, depth - 1) for k, v in value.items())
    if type(value) is list:
        return depth > 0 and all(is_plain(each, depth - 1) for each in value)
    return is_text(value) or is_truth(value) or is_number(value)


def lists(check: Check) -> Check:
    """Return a check that a value is a list whose items all pass `check`."""
    return lambda value: type(value) is list and all(map(check, value))


def maps(check: Check) -> Check:
    """Return a check that a value is a map from texts to values that all pass `check`."""
    return lambda value: (
        type(value) is dict and all(is_text(k) and check(v) for k, v in value.items())
    )


def holds(**checks: Check) -> Check:
    """Return a check that a value is a map whose values pass the checks that are given by key.

    Any of these keys may be missing. A further key must be a text, and its value plain.
    """
    return lambda value: not wrong_keys(value, checks) if type(value) is dict else False


def wrong_keys(content: Mapping[Any, Any], checks: Mapping[str, Check]) -> list[str]:
    """Return the keys of a map whose values do not pass their checks.

    The value of a key without a check must be plain; a key that is no text is wrong too. Keys are
    returned as texts, cut off after 40 characters.
    """
    return [
        str(name)[:40]
        for name, value in content.items()
        if not is_text(name) or not checks.get(name, is_plain)(value)
    ]


HEADER: Final[Mapping[str, Check]] = {
    "version": is_count, "session": is_text, "sequence": is_count, "sent_ns": is_whole,
}  # fmt: skip
"""Keys that every message must have, with the checks of their values."""

_TIMES: Final = holds(p50_s=is_number, p99_s=is_number, max_s=is_number)
_TRIP: Final = holds(by=is_text, cause=is_text, sentence=is_text, remedy=is_text, after_s=is_number)
_TEST: Final = holds(
    name=is_text, expect=is_text, duration_s=is_number, status=is_text, verdict=is_text,
    message=is_text,
)  # fmt: skip


def _is_nil_or(check: Check) -> Check:
    return lambda value: value is None or check(value)


FIELDS: Final[Mapping[str, Mapping[str, Check]]] = {
    "channels": {"id": is_count, "names": lists(is_text), "units": lists(is_text)},
    "samples": {
        "channels_id": is_count, "first_row": is_count, "rows": is_count, "test": is_whole,
        "newest_ns": is_whole, "time_s": is_packed, "values": is_packed,
    },
    "decision": {
        "verdict": is_text, "probabilities": maps(is_number), "statistic": is_number,
        "threshold": is_number, "leak_m3_per_s": is_number, "leak_std_m3_per_s": is_number,
        "interval_m3_per_s": _is_nil_or(lists(is_number)), "onset_s": is_number,
        "present_leaks": lists(is_number), "suspected": _is_nil_or(is_text),
        "details": maps(is_plain), "test": is_number, "name": is_text, "time_s": is_number,
        "intermittent": is_truth, "duty": is_number, "openings": is_count,
        "could_also_be": is_text, "growth": is_text,
    },
    "event": {
        "at_ns": is_number, "time_s": is_number, "who": is_text, "kind": is_text, "text": is_text,
    },
    "health": {
        "rate_hz": is_number, "rows": is_number, "recorded": is_number, "missed": is_number,
        "exchange_errors": is_number, "timing": maps(_TIMES), "silent_s": maps(is_number),
        "action": is_text, "cause": is_text, "sentence": is_text, "homed": is_truth,
        "trips": holds(first_out=lists(_TRIP), confirmed=maps(is_number)),
    },
    "campaign": {
        "status": is_text, "name": is_text, "description": is_text, "rig": is_text,
        "model": is_text, "filter": is_text, "directory": is_text, "rig_time_s": is_number,
        "begun_ns": is_number, "begun_by": is_text, "tests": lists(_TEST), "activity": is_text,
        "hands_over": is_text, "resumed": is_truth,
    },
    "progress": {
        "number": is_number, "count": is_number, "name": is_text, "expect": is_text,
        "time_s": is_number, "duration_s": is_number, "verdict": is_text,
    },
    "state": {
        "state": is_text, "since_ns": is_number, "before": is_text, "compiles": is_text,
        "compiles_since_ns": is_number,
    },
    "heartbeat": {
        "heartbeat_s": is_period, "up_s": is_number, "rows": is_number,
        "sequences": maps(is_count), "commands": is_truth,
    },
}  # fmt: skip
"""By kind of message: its known keys, with the checks of their values."""

NEEDED: Final[Mapping[str, tuple[str, ...]]] = {
    "channels": tuple(FIELDS["channels"]),
    "samples": tuple(FIELDS["samples"]),
    "heartbeat": ("heartbeat_s", "sequences"),
}
"""By kind of message: the keys that it must have; any other known key may be missing."""
