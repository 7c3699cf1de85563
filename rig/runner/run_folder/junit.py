"""Writes `junit.xml`, from which CI servers show a campaign, with one case for each test."""

import re
from pathlib import Path
from typing import Final

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite
from junitparser.junitparser import FinalResult

from rig.recording import replacing
from rig.runner.leak_test import leak_test_lines
from rig.runner.outcomes import CampaignOutcome, Status, TestOutcome, in_passing, litres_per_minute

_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


def write_junit(outcome: CampaignOutcome, path: Path) -> None:
    """Write the outcome of a campaign so far as `junit.xml`, replacing the file in one step."""
    suite = TestSuite(_text(outcome.name))
    suite.timestamp = outcome.started
    for name in ("rig", "model", "filter", "false_alarms_per_day"):
        suite.add_property(name, _text(str(getattr(outcome, name))))
    for test in outcome.tests:
        suite.add_testcase(_case(outcome.name, test))
    suite.update_statistics()
    document = JUnitXml(_text(outcome.name))
    document.add_testsuite(suite)
    document.update_statistics()
    with replacing(path) as partial:
        document.write(str(partial), pretty=True)


def _case(campaign: str, test: TestOutcome) -> TestCase:
    case = TestCase(_text(test.name), classname=_text(campaign), time=round(test.wall_s, 3))
    found = _result(test)
    if found is not None:
        case.result = [found]
    lines = [] if test.decision is None else in_passing(test.decision, test.found)
    if test.leak_test is not None:
        lines += leak_test_lines(test.leak_test)
    if lines:
        case.system_out = _text("\n".join(lines))
    return case


def _result(test: TestOutcome) -> FinalResult | None:
    if test.status == Status.PASSED:
        return None
    if test.status == Status.FAILED:
        return Failure(_text(_injected_against_found(test)), "verdict")
    if test.status in (Status.NOT_RUN, Status.SKIPPED):
        return Skipped(_text(test.message or "not run"), str(test.status))
    return Error(_text(test.message), str(test.status))


def _injected_against_found(test: TestOutcome) -> str:
    faults = (f"{a.kind}{_flow(a.mean_flow_m3_per_s)} at {a.at_s:g} s" for a in test.injected)
    injected, found = ", ".join(faults) or "nothing", "nothing"
    if test.decision is not None:
        onset_s = test.decision.onset_s
        since = "" if onset_s is None else f" since {onset_s:.2f} s"
        found = f"{test.decision.verdict}{_flow(test.decision.leak_m3_per_s)}{since}"
    missed = "".join(f"; not met: {each}" for each in test.missed)
    return f"expected {test.expect}; injected {injected}; found {found}{missed}"


def _flow(flow: float | None) -> str:
    return "" if flow is None else f" of {litres_per_minute(flow):.3f} L/min"


def _text(text: str) -> str:
    return _NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text)
