"""Puts figures and verdicts into words, in the units of the pages: L/min and s."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from estimator.leaks import Decision
from rig.plant import LEAKS, LITRE_PER_MINUTE
from rig.runner.outcomes import CampaignOutcome, InjectedFault, Status, TestOutcome, in_passing

_LABELS: Final = {
    "external_leakage_1": "external leak 1",
    "external_leakage_2": "external leak 2",
    "internal_leakage": "internal leak",
    "supply_leakage": "supply-line leak",
    "return_blockage": "return-line blockage",
    "multiple": "several faults at once",
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
    """Return the kinds of the leaks in a decision; its flow is that of all of them together."""
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
    """Return an injected fault's size as text: its recorded mean flow, else its coefficient."""
    if fault.mean_flow_m3_per_s is not None:
        return f"{flow(fault.mean_flow_m3_per_s)} L/min"
    if fault.kind == "return_blockage":
        return f"{fault.coefficient:.3g} Pa/(m³/s)²"
    return f"{fault.coefficient:.3g} m³/(s {'Pa' if fault.linear else '√Pa'})"


def acted(fault: InjectedFault) -> str:
    """Return in words from when to when an injected fault acted."""
    if fault.until_s is None:
        return f"from {fault.at_s:.1f} s"
    return f"{fault.at_s:.1f} s to {fault.until_s:.1f} s"


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


def story(test: TestOutcome) -> str:
    """Return what was injected and found in a test, and how the loop reacted, in sentences."""
    sentences = [_injection(test.injected), _finding(test)]
    if test.decision is not None and (passing := in_passing(test.decision, test.found)):
        sentences.append(f"Found in passing: {'; '.join(passing)}.")
    sentences.append(_reacting(test))
    if test.status is Status.FAILED:
        sentences.append(f"Expected was: {label(test.expect)}.")
    if 0.0 < test.recorded_s < test.duration_s - 0.01:
        sentences.append(f"The test ended after {test.recorded_s:.1f} s of {test.duration_s:g} s.")
    return " ".join(sentence for sentence in sentences if sentence)


def _injection(injected: Sequence[InjectedFault]) -> str:
    if not injected:
        return "No fault was injected."
    sentences = []
    for fault in injected:
        what = _OPENED.get(fault.kind, f"{label(fault.kind)} was injected")
        mean = "" if fault.mean_flow_m3_per_s is None else " on average"
        until = "" if fault.until_s is None else f", until {fault.until_s:.1f} s"
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
    faulty = [test for test in judged if test.injected]
    healthy = [test for test in judged if not test.injected]
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
