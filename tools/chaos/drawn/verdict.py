"""Judges a drawn case: what its devices recorded, and what was said of it, against the promises."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any, Final

from tools.chaos.judge import driven, safe_at

from .bounds import BYPASS_AFTER_NULL, BYPASS_BY_WATCHDOG, DATA, PUMP_AFTER_NULL, PUMP_BY_WATCHDOG
from .fault import null_deadlines
from .grammar import causes_of
from .pauses import paused_ns
from .play import Evidence

_TOLD_NS: Final = 1_200_000_000
"""How long after the valve's null a part may still be the first to name a cause: the longest
silence after which one is missed is 1 s, and the device may have nulled the valve before."""
_SLOW: Final = frozenset({"field", "bypass", "drive", "pump", "supervisor"})
"""What the bypass valves and the pump unit need to be made safe before their watchdogs do it."""
_STOPPED: Final = ("tripped", "aborted", "interrupted")


def violations(evidence: Evidence) -> list[str]:
    """Return a message for each invariant that a case did not keep; [] if all hold."""
    found = chain(
        _late_devices(evidence), _false_words(evidence), _lost_data(evidence), _left(evidence)
    )
    return list(found)


def enabled_spans(events: Iterable[Mapping[str, Any]]) -> list[tuple[int, int | None]]:
    """Return from when to when (ns) the valve was enabled, by the record; None: to its end."""
    spans: list[tuple[int, int | None]] = []
    for event in sorted(events, key=lambda event: event["at_ns"]):
        is_open = bool(spans) and spans[-1][1] is None
        if event["event"] == "valve_enabled" and not is_open:
            spans.append((event["at_ns"], None))
        elif event["event"] == "valve_disabled" and is_open:
            spans[-1] = (spans[-1][0], event["at_ns"])
    return spans


def null_ns(evidence: Evidence) -> int | None:
    """Return when the valve was disabled for good, ns; None if it was not, or never enabled."""
    spans = enabled_spans(evidence.events)
    return spans[-1][1] if spans else None


def _late_devices(evidence: Evidence) -> Iterator[str]:
    spans = enabled_spans(evidence.events)
    for name, until_ns in null_deadlines(evidence.struck):
        for begin_ns, end_ns in spans:
            since_ns = min(max(begin_ns, until_ns - 1_000_000_000), until_ns)
            allowed_ns = until_ns + _pauses(evidence, since_ns, end_ns or until_ns)
            if end_ns is None or end_ns > allowed_ns:
                late = "for ever" if end_ns is None else f"{1e-6 * (end_ns - until_ns):.0f} ms"
                yield f"the valve is not at null in time after {name}: {late} too late"
    yield from _late_slow_devices(evidence)


def _late_slow_devices(evidence: Evidence) -> Iterator[str]:
    """Yield messages on bypass valves and pump unit, whose times count from the valve's null."""
    spoilt = frozenset[str]().union(*(each.fault.spoils for each in evidence.struck))
    safe = safe_at(list(evidence.events))
    moved = driven(list(evidence.events))
    lost = [each for each in evidence.struck if each.fault.takes & _SLOW]
    bypass, pump = (
        (BYPASS_BY_WATCHDOG, PUMP_BY_WATCHDOG) if lost else (BYPASS_AFTER_NULL, PUMP_AFTER_NULL)
    )
    nulled_ns = null_ns(evidence)
    for device, bound in (("bypass", bypass), ("pump", pump)):
        at_ns = safe[device]
        if device in spoilt:
            continue
        if at_ns is None:
            if device in moved:
                yield f"the {device} is not safe"
            continue
        if nulled_ns is None or not _must_trip(evidence):
            continue
        from_ns = max(nulled_ns, *(each.done_ns for each in lost if each.at_ns < at_ns), 0)
        late_ns = at_ns - from_ns - round(1e6 * bound.ms)
        if late_ns > _pauses(evidence, from_ns, at_ns):
            yield f"the {device} is safe {1e-6 * late_ns:.0f} ms too late"


def _must_trip(evidence: Evidence) -> bool:
    return any(each.fault.null_ms is not None for each in evidence.struck)


def _pauses(evidence: Evidence, begin_ns: int, end_ns: int) -> int:
    return paused_ns(evidence.pauses, begin_ns, end_ns)


def _false_words(evidence: Evidence) -> Iterator[str]:
    faults = tuple(each.fault for each in evidence.struck)
    exits = frozenset[int]({0, 1}).union(*(fault.exits for fault in faults))
    if any(fault.null_ms is not None for fault in faults):
        exits -= {0, 1}
    if any(fault.exits == {-9} for fault in faults):
        exits = frozenset({-9})
    if evidence.exit_code is not None and evidence.exit_code not in exits:
        yield f"exit code {evidence.exit_code}, not {' or '.join(map(str, sorted(exits)))}"
    yield from _false_cause(evidence)
    safe = safe_at(list(evidence.events))
    for device in sorted(evidence.confirmed):
        if safe[device] is None and device in driven(list(evidence.events)):
            yield f"the trip report calls the {device} confirmed safe, and it is not"
    if "Traceback" in evidence.printed:
        yield "a traceback"
    yield from _false_results(evidence, may_miss=not all(fault.keeps_results for fault in faults))


def _false_cause(evidence: Evidence) -> Iterator[str]:
    ended_well = evidence.exit_code in (0, 1)
    if ended_well:
        if evidence.cause or evidence.trip_reports:
            yield f"the run ended as if all was well, and tells of {evidence.cause or 'a trip'}"
        return
    nulled_ns = null_ns(evidence)
    before = tuple(
        each.fault
        for each in evidence.struck
        if nulled_ns is None or each.at_ns <= nulled_ns + _TOLD_NS
    )
    causes = causes_of(before)
    if evidence.exit_code is not None and evidence.exit_code < 0:
        causes.add("")
    if not any(_says(evidence.cause, cause) for cause in causes):
        told = evidence.cause or "nothing"
        yield f"it tells of {told}, not of {' or '.join(sorted(causes)) or 'nothing'}"


def _says(told: str, cause: str) -> bool:
    return told == cause if cause.isupper() or not cause else told.startswith(cause)


def _false_results(evidence: Evidence, *, may_miss: bool) -> Iterator[str]:
    if may_miss:
        # What stands there may be what the run wrote when it began.
        return
    if evidence.results is None:
        yield "there are no results"
        return
    if evidence.exit_code is None or evidence.exit_code < 0:
        return
    if evidence.results["exit_code"] != evidence.exit_code:
        told = evidence.results["exit_code"]
        yield f"results.json tells exit code {told}, and the run ended with {evidence.exit_code}"
    (test,) = evidence.results["tests"]
    if (evidence.exit_code == 3) != (test["status"] in _STOPPED):
        yield f"the test is called {test['status']}, with exit code {evidence.exit_code}"


def _lost_data(evidence: Evidence) -> Iterator[str]:
    if evidence.journal_problem:
        yield f"the journal cannot be read: {evidence.journal_problem}"
    killed = evidence.exit_code is not None and evidence.exit_code < 0
    if evidence.unfinished and not killed:
        yield f"left half written: {', '.join(evidence.unfinished)}"
    bound_s = 1e-3 * DATA.ms
    if evidence.lost_s is None:
        yield "nothing of the recording can be read"
    elif evidence.lost_s > bound_s + 1e-9 * _pauses_before(evidence):
        yield f"the last {evidence.lost_s:.1f} s before the first fault are lost"


def _pauses_before(evidence: Evidence) -> int:
    first_ns = min((each.at_ns for each in evidence.struck), default=0)
    return _pauses(evidence, first_ns - 3_000_000_000, first_ns + 1_000_000_000)


def _left(evidence: Evidence) -> Iterator[str]:
    if evidence.exit_code is None:
        yield "the run did not end"
    if evidence.alive:
        yield f"still alive: {', '.join(evidence.alive)}"
