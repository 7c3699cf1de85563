"""Puts figures, verdicts and the conditions of a test into words, in the units of the pages.

The units are L/min and s. Setpoint, load and the loop's grants come from the metadata of a
recording, the loop's timing from its events.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

from estimator.leaks import Decision, Found
from faults import Verdict, size_shown
from rig.loop import TIMING, in_short
from rig.plant import LEAKS, LITRE_PER_MINUTE
from rig.recording import Recording
from rig.runner.outcomes import (
    CampaignOutcome,
    InjectedFault,
    Status,
    TestOutcome,
    comes_and_goes,
    drifts,
    grows,
    last_seen,
    others_found,
)

_LABELS: Final = {
    "external_leakage_1": "external leak 1",
    "external_leakage_2": "external leak 2",
    "internal_leakage": "internal leak",
    "supply_leakage": "supply-line leak",
    "return_blockage": "return-line blockage",
    "multiple": "several faults at once",
    "encoder_drift": "drift of the encoder",
}
"""Verdicts and kinds of faults whose names are not simply read with spaces for underscores."""
_OPENED: Final = {
    "external_leakage_1": "a leak from chamber 1 to the return line was opened",
    "external_leakage_2": "a leak from chamber 2 to the return line was opened",
    "internal_leakage": "a leak past the piston, from chamber to chamber, was opened",
    "supply_leakage": "the supply line was made to leak to the return line",
    "return_blockage": "the return line was throttled",
}
STATUS_LABELS: Final = {
    Status.PASSED: ("✓", "passed"),
    Status.FAILED: ("✗", "failed"),
    Status.ERROR: ("!", "error"),
    Status.ABORTED: ("■", "aborted"),
    Status.TRIPPED: ("⏻", "tripped"),
    Status.SKIPPED: ("»", "skipped"),
    Status.INTERRUPTED: ("↺", "interrupted"),
    Status.NOT_RUN: ("–", "not run"),
}
"""Symbol and word for each status of a test, which are understood without the colour."""
_UNITS_BY_ENDING: Final = {"_hz_per_s": "Hz/s", "_hz": "Hz", "_rad": "rad", "_s": "s"}
_FEW: Final = 8
"""Greatest length of a list whose values are written one by one."""


def label(verdict: str) -> str:
    """Return a verdict or fault kind in words."""
    return _LABELS.get(verdict, verdict.replace("_", " "))


def flow(m3_per_s: float) -> str:
    """Return a flow given in m^3/s as text in L/min, without the unit.

    It has two decimals, or three below 0.1 L/min.
    """
    litres = m3_per_s / LITRE_PER_MINUTE
    return f"{litres:.3f}" if 0.0 < abs(litres) < 0.0995 else f"{litres:.2f}"


def seconds(time_s: float) -> str:
    """Return a time as text in s with two decimals and the unit."""
    return f"{time_s:.2f} s"


def found_names(decision: Decision) -> str:
    """Return a decision's verdict in words; for `multiple`, the names of its faults."""
    return " and ".join(map(label, _several(decision) or [decision.verdict]))


def leaks_found(decision: Decision) -> list[str]:
    """Return the kinds of the leaks that a decision names; its flow is that of all of them."""
    return [kind for kind in _several(decision) or [decision.verdict] if kind in LEAKS]


def _several(decision: Decision) -> list[str]:
    if decision.verdict != "multiple":
        return []
    named = [
        key.removesuffix("_coefficient") for key in decision.details if key.endswith("_coefficient")
    ]
    return [kind for kind in named if kind in _LABELS]


def found_flow(decision: Decision) -> str:
    """Return a decision's leak flow with its 95 % interval as text; empty if it has no flow."""
    if decision.leak_m3_per_s is None:
        return ""
    found = flow(decision.leak_m3_per_s)
    if decision.interval_m3_per_s is not None:
        lower, upper = (flow(bound) for bound in decision.interval_m3_per_s)
        found = f"{found} ({lower} to {upper})"
    return f"{found} L/min" + (" together" if len(leaks_found(decision)) > 1 else "")


def injected_size(fault: InjectedFault) -> str:
    """Return an injected fault's size as text: its recorded mean flow, else what was asked for."""
    if fault.mean_flow_m3_per_s is not None:
        return f"{flow(fault.mean_flow_m3_per_s)} L/min"
    if fault.kind == "return_blockage":
        return f"{fault.coefficient:.3g} Pa/(m³/s)²"
    return size_shown(fault.kind, fault.coefficient, linear=fault.linear)


def acted(fault: InjectedFault, recorded_s: float) -> str:
    """Return in words from when to when an injected fault acted.

    Args:
        fault: the fault.
        recorded_s: how long its test lasted, s; 0 if that is not known.
    """
    if fault.until_s is None:
        return f"from {fault.at_s:.1f} s"
    if is_after(fault.until_s, recorded_s):
        return f"from {fault.at_s:.1f} s to the end at {recorded_s:.1f} s"
    return f"{fault.at_s:.1f} s to {fault.until_s:.1f} s"


def is_after(time_s: float, recorded_s: float) -> bool:
    """Return whether a time of a test, s, had not come when the test ended after `recorded_s`.

    It is False if `recorded_s` is 0, as for an older run, which does not tell how long it lasted.
    """
    return 0.0 < recorded_s < time_s - _ROUNDING_S


def when(started: str) -> str:
    """Return an ISO 8601 time in words, in UTC if it states its zone; other texts are unchanged."""
    try:
        moment = datetime.fromisoformat(started)
    except ValueError:
        return started
    if moment.tzinfo is not None:
        moment = moment.astimezone(UTC)
    return f"{moment.day} {moment:%B %Y, %H:%M %Z}".rstrip()


def latency(test: TestOutcome) -> str:
    """Return the time from the first injected fault to the final verdict, in words.

    The verdict's time is when the detector first came to it, even if it names the wrong fault. The
    text is "before the injection" if the verdict came earlier than the fault. It is empty if
    nothing was injected, or if the final verdict names no fault.
    """
    if test.latency_s is None:
        return ""
    return seconds(test.latency_s) if test.latency_s >= 0.0 else "before the injection"


_LIMITS_SHOWN: Final = 5
_ROUNDING_S: Final = 0.01
"""A test that ended so much before a time, s, or less, ended at that time: ten ticks, far less than
the 0.1 s to which times are shown."""


def story(test: TestOutcome) -> str:
    """Return what was injected and found in a test, and how the loop reacted, in sentences."""
    sentences = [_injection(test.injected, test.recorded_s), _finding(test)]
    if test.decision is not None:
        sentences += _besides(test.decision, test.found)
    sentences.append(_reacting(test))
    verdict = None if test.decision is None else test.decision.verdict
    if test.status is Status.FAILED and verdict != test.expect:
        sentences.append(f"Expected was: {label(test.expect)}.")
    sentences += [f"Not met: {each}." for each in test.missed]
    sentences.append(_limits_passed(test))
    sentences += [f"T{str(each)[1:]}." for each in test.limits_not_judged[:_LIMITS_SHOWN]]
    if changed := "; ".join(str(each) for each in test.control_changes):
        sentences.append(f"Control changed {changed}.")
    # How long a leak test takes is not known to the second beforehand.
    if is_after(test.duration_s, test.recorded_s) and test.leak_test is None:
        early = any(each.ended_early for each in test.segments)
        most = " at most, as segments ended early" if early and not test.message else ""
        ended = f"The test ended after {test.recorded_s:.1f} s of {test.duration_s:g} s"
        sentences.append(f"{ended}{most}.")
    return " ".join(sentence for sentence in sentences if sentence)


def _besides(decision: Decision, found: Sequence[Found]) -> Iterator[str]:
    """Yield sentences on the course of the verdict's fault, and on other faults that were found."""
    if decision.growth is not None:
        yield f"It {grows(decision.growth)}."
    if decision.drift is not None:
        clause = drifts(decision.drift, decision.could_also_be)
        yield f"{clause[0].upper()}{clause[1:]}."
    if decision.returns is not None:
        yield f"It {comes_and_goes(decision.returns)}."
    if decision.ended_s is not None:
        seen = last_seen(decision.ended_s, comes_and_goes=decision.returns is not None)
        yield f"It was {seen}."
    if others := others_found(decision, found):
        yield f"Found in passing: {'; '.join(others)}."


def _limits_passed(test: TestOutcome) -> str:
    """Return which limits were passed, each with its first passing and how often it was again."""
    first: dict[tuple[str, str, str, str, float], str] = {}
    times: Counter[tuple[str, str, str, str, float]] = Counter()
    for each in test.limits:
        which = each.of, each.watched, each.each, each.band, each.limit
        first.setdefault(which, str(each))
        times[which] += 1
    told = [text + _more(times[which] - 1) for which, text in first.items()]
    left = len(told) - _LIMITS_SHOWN
    more = f"; and {left} more limits" if left > 0 else ""
    return f"Limits exceeded: {'; '.join(told[:_LIMITS_SHOWN])}{more}." if told else ""


def _injection(injected: Sequence[InjectedFault], recorded_s: float) -> str:
    if not injected:
        return "No fault was injected."
    sentences = []
    for fault in injected:
        what = _OPENED.get(fault.kind, f"{label(fault.kind)} was injected")
        mean = "" if fault.mean_flow_m3_per_s is None else " on average"
        until = "" if fault.until_s is None else f", until {fault.until_s:.1f} s"
        if fault.until_s is not None and is_after(fault.until_s, recorded_s):
            until = f", until the test ended at {recorded_s:.1f} s"
        sentences.append(f"At {fault.at_s:.1f} s {what} ({injected_size(fault)}{mean}{until}).")
    return " ".join(sentences)


def _finding(test: TestOutcome) -> str:
    decision = test.decision
    if decision is None:
        return "The detector came to no verdict."
    if decision.verdict == "healthy":
        return "The detector found nothing wrong."
    if decision.verdict == "inconclusive":
        return f"The detector could not tell{_why_not(decision)}."
    found = ", ".join(filter(None, (found_names(decision), found_flow(decision)))) + "."
    late = test.latency_s
    if late is not None and late >= 0.0:
        return f"The detector called it {seconds(late)} later: {found}"
    if test.detected_at_s is not None:
        return f"The detector raised an alarm at {seconds(test.detected_at_s)}: {found}"
    return f"The detector found: {found}"


def _reacting(test: TestOutcome) -> str:
    if not test.actions:
        return ""
    first, last = test.actions[0], test.actions[-1]
    if first.holds:
        return f"From {first.at_s:.1f} s on the loop held the ram where it was."
    until = "on" if last.until_s is None else f"to {last.until_s:.1f} s"
    return f"From {first.at_s:.1f} s {until} the loop made up for it."


def _why_not(decision: Decision) -> str:
    if decision.suspected is not None:
        name = label(decision.suspected)
        return f": {name} is likely, but not sure at the stated false-alarm rate"
    travel, needed = (decision.details.get(key, 0.0) for key in ("travel_m", "travel_needed_m"))
    if travel < needed:
        moved, least = travel * 1e3, needed * 1e3
        return f": the ram moved by {moved:.2g} mm, and a leak shows from {least:.2g} mm on"
    return ": what was recorded would not have shown a leak"


def headline(outcome: CampaignOutcome) -> str:
    """Return a campaign's result in a sentence."""
    tests, passed = len(outcome.tests), outcome.counts.get(Status.PASSED, 0)
    if tests == 0:
        return "The campaign has no tests."
    if passed == tests:
        return f"All {tests} tests came out as expected." if tests > 1 else "The test passed."
    return f"{passed} of {tests} tests came out as expected."


def detection_summary(outcome: CampaignOutcome) -> str:
    """Return sentences on a campaign's detections: right names, latency, errors, false alarms.

    The text is empty if no test was judged.
    """
    judged = [test for test in outcome.tests if test.decision is not None]
    # What an emulator's script injects is only known by the verdict that is expected of it.
    faulty = [test for test in judged if test.injected or test.expect != Verdict.HEALTHY]
    healthy = [test for test in judged if test not in faulty]
    sentences = []
    if faulty:
        named = [test for test in faulty if test.decision and test.decision.verdict == test.expect]
        sentences.append(_named(named, len(faulty)))
        errors = [abs(e) for test in named if (e := test.leak_error_m3_per_s) is not None]
        if errors:
            largest = f"{max(errors) / LITRE_PER_MINUTE:.2g} L/min"
            sentences.append(f"Mean leak flows found and recorded differ by {largest} at most.")
    if healthy:
        alarms = sum(test.detected_at_s is not None for test in healthy)
        time = sum(test.recorded_s or test.duration_s for test in healthy)
        count = "one healthy test" if len(healthy) == 1 else f"{len(healthy)} healthy tests"
        sentences.append(
            f"Of {count}, {time:.0f} s, {alarms} had a false alarm."
            if alarms
            else f"No false alarm in {count}, {time:.0f} s."
        )
    return " ".join(sentences)


def _named(named: Sequence[TestOutcome], faulty: int) -> str:
    late = sorted(test.latency_s for test in named if test.latency_s is not None)
    after = ""
    if late:
        ends = dict.fromkeys(f"{latency_s:.1f}" for latency_s in (late[0], late[-1]))
        after = f", {' to '.join(ends)} s after {'they' if faulty > 1 else 'it'} began"
    if len(named) < faulty:
        return f"{len(named)} of {faulty} faults were named right{after}."
    which = f"All {faulty} faults were" if faulty > 1 else "The fault was"
    return f"{which} named right{after}."


def conditions_of(metadata: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield setpoint and load of a test as (name, text), without those that are not recorded.

    Args:
        metadata: metadata of the test's recording.
    """
    test = metadata.get("test")
    if not isinstance(test, Mapping):
        return
    for name, key, in_words in (("Setpoint", "setpoint", _setpoint), ("Load", "load", _load)):
        recorded = test.get(key)
        if isinstance(recorded, Mapping):
            yield name, in_words(recorded)


def loop_conditions(recording: Recording) -> Iterator[tuple[str, str]]:
    """Yield the grants and the timing of a hardware rig's loop as (name, text), if recorded."""
    loop = recording.metadata.get("loop")
    if isinstance(loop, Mapping):
        shown = [
            f"{'' if grant.get('granted') else 'without '}{grant.get('name', '')}"
            for grant in loop.get("grants", ())
            if isinstance(grant, Mapping)
        ]
        yield "Loop ran with", ", ".join(shown) or "nothing granted"
    for event in recording.events:
        if event.kind == TIMING:
            yield "Loop timing", in_short(json.loads(event.text)) or "no tick was counted"


def _setpoint(setpoint: Mapping[str, Any]) -> str:
    metres = setpoint.get("quantity", "position") == "position"
    parts = [
        _with_unit(key, value, metres)
        for key, value in setpoint.items()
        if key not in ("type", "quantity") and value is not None
    ]
    if "stretches" in setpoint:
        return f"{len(setpoint['stretches'])} segments one after the other"
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(setpoint.get("type", "setpoint"))).lower()
    return f"{kind}: {', '.join(parts)}" if parts else kind


def _with_unit(key: str, value: Any, metres: bool) -> str:
    if key in ("seed", "path"):
        return f"{key} {value}"
    for ending, unit in _UNITS_BY_ENDING.items():
        if key.endswith(ending):
            return f"{key.removesuffix(ending).replace('_', ' ')} {_number(value, 1.0, unit)}"
    scale, unit = (1e3, "mm") if metres else (1.0, "V")
    return f"{key.replace('_', ' ')} {_number(value, scale, unit)}"


def _number(value: Any, scale: float, unit: str) -> str:
    if isinstance(value, list | tuple):
        if len(value) > _FEW:
            return f"({len(value)} values)"
        return " / ".join(_number(item, scale, "") for item in value) + f" {unit}"
    if isinstance(value, int | float):
        return f"{value * scale:.6g} {unit}".rstrip()
    return str(value)


def _load(load: Mapping[str, Any]) -> str:
    try:
        stiffness, contact = float(load["stiffness"]), float(load["contact"])
    except (KeyError, TypeError, ValueError):
        return "as recorded in the metadata"
    return f"spring of {stiffness:.3g} N/m, met at {contact * 1e3:g} mm"


def _more(times: int) -> str:
    """Return the words for how many times more something happened; "" for none."""
    if times == 0:
        return ""
    return ", and once more" if times == 1 else f", and {times} times more"
