"""A rig's snapshot is turned into the sections of the page, as JSON in units of the screen."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import isfinite, nan
from typing import Any, Final

from rig.channels import BYPASSES, KPA, LITRES_PER_MINUTE, SHOWN
from rig.stream import Snapshot

EVENTS: Final = 60
VERDICTS: Final = 30
MOST_TESTS: Final = 2000
MOST_HELD: Final = 10
MOST_UNSEEN: Final = 8
SHOWN_OF_TESTS: Final = ("name", "expect", "status", "verdict", "message")

READINGS: Final = sorted(
    SHOWN, key=lambda row: row[0] not in ("position_m", "setpoint_m", "command_V", "spool_m")
)
"""Channels that are shown as numbers: first those of the ram and the valve, then the others."""

LEAK_METERS: Final = {
    "external_leakage_1": "flow_1_m3_per_s",
    "external_leakage_2": "flow_2_m3_per_s",
    "internal_leakage": "flow_internal_m3_per_s",
}
SHUT: Final = 0.01
"""Largest opening, as a fraction of 1, at which a valve counts as shut."""
CONTACTS: Final = (
    ("emergency stop", "estop_closed", {1: ("closed", "good"), 0: ("open", "bad")}),
    ("I/O watchdog", "watchdog_tripped", {0: ("watching", "good"), 1: ("tripped", "bad")}),
    ("encoder", "encoder_fault", {0: ("counting", "good"), 1: ("fault", "bad")}),
    ("valve", "valve_enabled", {1: ("enabled", "live"), 0: ("disabled", "off")}),
    ("pump", "pump_loaded", {1: ("loaded", "live"), 0: ("unloaded", "off")}),
)
"""Name and channel of each contact, and by value the text that is shown and its style."""
HOMED: Final = {True: ("homed", "good"), False: ("not homed", "off")}
UNKNOWN: Final = ("not known", "off")
STAGES: Final = (
    ("lateness", "wakeup"), ("exchange", "exchange"), ("compute", "compute"), ("sample age", "age"),
)  # fmt: skip


def sections(snapshot: Snapshot) -> dict[str, Any]:
    """Return all that is shown of a rig, except its curves: section -> JSON values.

    Values are in units of the screen, which their keys name; None stands for what is not known.
    """
    return {
        "life": _life(snapshot),
        "readings": _readings(snapshot),
        "bypass": _bypasses(snapshot),
        "interlocks": _interlocks(snapshot),
        "health": _health(snapshot),
        "progress": _progress(snapshot),
        "campaign": _campaign(snapshot),
        "decision": _decision(snapshot),
        "last": _last(snapshot),
        "verdicts": _verdicts(_as_it_ended(snapshot)),
        "events": [_event(content) for content in snapshot.events[-EVENTS:]],
    }


def _life(snapshot: Snapshot) -> dict[str, Any]:
    return {
        "life": snapshot.life,
        "age_s": _rounded(snapshot.age_s, 1),
        "rate_hz": round(snapshot.rate_hz),
        "time_s": _rounded(snapshot.time_s, 1),
        **_texts(snapshot.state, "state", "before", "compiles"),
        "compiles_since_ms": _milliseconds(snapshot.state.get("compiles_since_ns")),
        "is_read": _is_read(snapshot),
        "restarts": snapshot.restarts,
        "missing": {str(kind): int(count) for kind, count in snapshot.missing.items() if count},
    }


def _is_read(snapshot: Snapshot) -> bool:
    """Return whether the samples that are known are what a rig that is heard now measures.

    Until a session has sent its first samples they are of the session before. Of a rig that is not
    heard any more they are what was, which its life says.
    """
    was = snapshot.life in ("ended", "dead")
    return bool(snapshot.latest) and (was or snapshot.is_sampled)


def _readings(snapshot: Snapshot) -> list[dict[str, Any]]:
    found = []
    for channel, (title, unit, digits, _) in READINGS:
        value = snapshot.latest.get(channel)
        if value is not None:
            text = f"{unit.shown(value):.{digits}f}" if isfinite(value) else None
            found.append({"name": title, "value": text, "unit": unit.text})
    return found


def _bypasses(snapshot: Snapshot) -> list[dict[str, Any]]:
    """Return opening and flow of each bypass valve whose position is known; [] if there is none."""
    latest = snapshot.latest
    found = []
    for bypass in BYPASSES:
        ball = _rounded(latest.get(f"{bypass}_ball"), 2)
        needle = _rounded(latest.get(f"{bypass}_needle"), 3)
        if ball is None and needle is None:
            continue
        flow = latest.get(LEAK_METERS.get(bypass, ""), float("nan"))
        metered = _rounded(LITRES_PER_MINUTE.shown(flow), 2)
        # No oil flows through a shut valve, so its meter's reading is the meter's zero error.
        opening = needle if ball is None else ball
        is_shut = opening is not None and opening <= SHUT
        found.append(
            {
                "name": bypass,
                "ball": ball,
                "needle": needle,
                "metered_L_per_min": None if is_shut else metered,
                "shut_L_per_min": metered if is_shut else None,
            }
        )
    return found


def _interlocks(snapshot: Snapshot) -> dict[str, Any]:
    health, latest = snapshot.health, snapshot.latest
    is_read = _is_read(snapshot)
    words = {
        name: meanings.get(round(latest[channel]), UNKNOWN)
        if is_read and isfinite(latest[channel])
        else UNKNOWN
        for name, channel, meanings in CONTACTS
        if channel in latest
    }
    if words:
        words["position"] = HOMED[bool(health.get("homed"))] if health else UNKNOWN
    # Trips in a health message of an earlier run are left out.
    trips = _mapping(health.get("trips")) if _is_of_this_run(snapshot, health) else {}
    return {
        "contacts": [
            {"name": name, "text": text, "how": how} for name, (text, how) in words.items()
        ],
        **_texts(health, "action", "sentence"),
        "first_out": [
            {
                **_texts(trip, "by", "cause", "sentence", "remedy"),
                "after_ms": _rounded(trip.get("after_s"), 0, 1e3),
            }
            for trip in _mappings(trips.get("first_out"))
        ],
        "confirmed": [
            {"step": str(step), "after_ms": _rounded(after_s, 0, 1e3)}
            for step, after_s in _mapping(trips.get("confirmed")).items()
        ],
    }


def _health(snapshot: Snapshot) -> dict[str, Any]:
    health = snapshot.health
    timing = _mapping(health.get("timing"))
    stages = [(name, _mapping(timing.get(stage))) for name, stage in STAGES]
    figures = ("p50", "p99", "max")
    return {
        **_numbers(health, 0, "rate_hz", "missed", "exchange_errors"),
        "stages_us": [
            {"name": name, **{key: _rounded(times.get(f"{key}_s"), 0, 1e6) for key in figures}}
            for name, times in stages
            if times
        ],
        "silent_ms": {
            str(part): _rounded(silent_s, 0, 1e3)
            for part, silent_s in _mapping(health.get("silent_s")).items()
        },
    }


def _progress(snapshot: Snapshot) -> dict[str, Any]:
    progress = snapshot.progress
    if not progress:
        return {}
    return {
        **_numbers(progress, 0, "number", "count"),
        **_texts(progress, "name", "expect"),
        **_numbers(progress, 1, "time_s", "duration_s"),
    }


def _campaign(snapshot: Snapshot) -> dict[str, Any]:
    campaign = snapshot.campaign
    if not campaign:
        return {}
    names = (
        "status", "name", "activity", "begun_by", "description", "rig", "model", "filter",
        "directory", "reason", "hands_over", "motion", "moved",
        "paused_by",
    )  # fmt: skip
    held = campaign.get("held")
    return {
        **_texts(campaign, *names),
        "begun_ms": _milliseconds(campaign.get("begun_ns")),
        **_numbers(campaign, 0, "rig_time_s", "exit_code"),
        "pausing": campaign.get("pausing") is True,
        "resumed": campaign.get("resumed") is True,
        "held": [_text(reason) for reason in held][:MOST_HELD] if isinstance(held, list) else [],
        "tests": [
            _texts(test, *SHOWN_OF_TESTS) | _numbers(test, 1, "duration_s")
            for test in _mappings(campaign.get("tests"))[:MOST_TESTS]
        ],
    }


def _as_it_ended(snapshot: Snapshot) -> Snapshot:
    """Return the snapshot of what drove a rig last, if it is a station's that says what that was.

    Any other snapshot is returned as it is.
    """
    last = _mapping(snapshot.campaign.get("last"))
    if not last:
        return snapshot
    health = {"trips": _mapping(last.get("trips"))}
    campaign, decision = (_mapping(last.get(name)) for name in ("campaign", "decision"))
    return replace(snapshot, campaign=campaign, decision=decision, health=health)


def _last(snapshot: Snapshot) -> dict[str, Any]:
    """Return what drove the rig last, as its station says; {} if it says nothing of that."""
    last = _mapping(snapshot.campaign.get("last"))
    if not last:
        return {}
    before, seen = _as_it_ended(snapshot), _mapping(last.get("acknowledged"))
    trips = _interlocks(before)
    return {
        "unseen": [_trip(use) for use in _mappings(last.get("unseen"))[-MOST_UNSEEN:]],
        "campaign": _campaign(before),
        "decision": _decision(before),
        "interlocks": {name: trips[name] for name in ("first_out", "confirmed")},
        "ended_ms": _milliseconds(last.get("ended_ns")),
        "acknowledged": {**_texts(seen, "by", "text"), "at_ms": _milliseconds(seen.get("at_ns"))}
        if seen
        else {},
    }


def _trip(use: Mapping[str, Any]) -> dict[str, Any]:
    names = ("name", "activity", "begun_by", "sentence")
    return {**_texts(use, *names), "ended_ms": _milliseconds(use.get("ended_ns"))}


def unseen_trips(last: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the trips that nobody has acknowledged, of a section `last`, the newest one last."""
    unseen, first = list(last.get("unseen", [])), last["interlocks"]["first_out"] if last else []
    if first and not last["acknowledged"]:
        campaign = {name: last["campaign"].get(name, "") for name in ("name", "activity")}
        by, ended_ms = last["campaign"].get("begun_by", ""), last["ended_ms"]
        what = {"sentence": first[0]["sentence"], "begun_by": by, "ended_ms": ended_ms}
        unseen.append(campaign | what)
    return unseen


def _decision(snapshot: Snapshot) -> dict[str, Any]:
    """Return the detector's decision; {} if there is none, or the last one is of an earlier run."""
    decision = snapshot.decision
    if not decision or not _is_of_this_run(snapshot, decision):
        return {}
    details = _mapping(decision.get("details"))
    probabilities = _mapping(decision.get("probabilities"))
    return {
        **_verdict(decision),
        **_numbers(decision, 2, "statistic", "threshold"),
        "thresholds_kPa": [
            _rounded(details.get(f"threshold_{chamber}_Pa"), 1, KPA.factor) for chamber in (1, 2)
        ],
        **_numbers(decision, 1, "onset_s", "ended_s"),
        **_numbers(decision, 3, "duty"),
        **_texts(decision, "suspected", "growth"),
        "probabilities": {str(name): _rounded(p, 4) for name, p in probabilities.items()},
    }


def _verdicts(snapshot: Snapshot) -> list[dict[str, Any]]:
    """Return the newest verdicts of the campaign that is shown, and of no earlier one."""
    mine = [each for each in snapshot.verdicts if _is_of_this_run(snapshot, each)]
    return [_verdict(content) for content in mine[-VERDICTS:]]


def _is_of_this_run(snapshot: Snapshot, content: Mapping[str, Any]) -> bool:
    """Return whether a message was sent after the campaign began; True if that is not known."""
    begun_ms = _milliseconds(snapshot.campaign.get("begun_ns"))
    sent_ms = _milliseconds(content.get("sent_ns"))
    return sent_ms is None or begun_ms is None or sent_ms >= begun_ms


def _verdict(content: Mapping[str, Any]) -> dict[str, Any]:
    interval = content.get("interval_m3_per_s")
    ends = interval if isinstance(interval, Sequence) and len(interval) == 2 else (None, None)
    return {
        "verdict": _text(content.get("verdict")),
        "test": _text(content.get("name")),
        "number": _rounded(content.get("test"), 0),
        "time_s": _rounded(content.get("time_s"), 1),
        "at_ms": _milliseconds(content.get("sent_ns")),
        "leak_L_per_min": [
            _rounded(value, 3, LITRES_PER_MINUTE.factor)
            for value in (content.get("leak_m3_per_s"), *ends)
        ],
    }


def _event(content: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "at_ms": _milliseconds(content.get("at_ns")),
        **_numbers(content, 1, "time_s"),
        **_texts(content, "who", "kind", "text"),
    }


# Any publisher on the stream can put any value anywhere in a message, so every value is checked.


def _text(value: Any) -> str:
    return str(value)[:500] if value is not None else ""


def _texts(content: Mapping[str, Any], *names: str) -> dict[str, str]:
    return {name: _text(content.get(name)) for name in names}


def _numbers(content: Mapping[str, Any], digits: int, *names: str) -> dict[str, float | None]:
    return {name: _rounded(content.get(name), digits) for name in names}


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _mappings(value: Any) -> list[Mapping[str, Any]]:
    items = value if isinstance(value, list) else []
    return [item for item in items if isinstance(item, Mapping)]


def _rounded(value: Any, digits: int, factor: float = 1.0) -> float | None:
    """Return a value times a factor, rounded to `digits` decimals.

    The result is None if the value is anything else than a finite number.
    """
    with suppress(OverflowError):
        scaled = float(value) * factor if isinstance(value, int | float) else nan
        return round(scaled, digits) if isfinite(scaled) else None
    return None


def _milliseconds(value: Any) -> int | None:
    return value // 10**6 if isinstance(value, int) else None
