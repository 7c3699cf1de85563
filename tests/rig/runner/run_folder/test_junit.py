from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, strategies as st
from junitparser import Error, Failure, JUnitXml, Skipped, TestCase

from estimator.leaks.detection import Decision
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome
from rig.runner.run_folder.junit import write_junit

LEAK = InjectedFault("internal_leakage", 18.0, None, 4e-9, False, 1.0 / 6e4)
TEST = TestOutcome("t", "internal_leakage", Status.PASSED, 3, 40.0, (LEAK,), Decision("healthy"))
OUTCOME = CampaignOutcome("c", "", "r", "m", "product", 1.0, "2026-01-01T00:00:00+00:00", ())


def written(*tests: TestOutcome) -> tuple[JUnitXml, list[TestCase]]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "junit.xml"
        write_junit(replace(OUTCOME, tests=tests), path)
        document = JUnitXml.fromfile(str(path))
    return document, list(next(iter(document)))


def test_every_way_to_end_has_its_place_in_junit() -> None:
    document, cases = written(*(replace(TEST, status=status, message="why") for status in Status))
    kinds = [type(case.result[0]) if case.result else None for case in cases]
    assert kinds == [None, Failure, Error, Error, Error, Skipped, Error, Skipped]
    assert (document.tests, document.failures, document.errors, document.skipped) == (8, 1, 4, 2)


def test_a_failure_tells_injected_against_found() -> None:
    _, cases = written(replace(TEST, status=Status.FAILED, wall_s=1.5))
    assert cases[0].result[0].message == (
        "expected internal_leakage; injected internal_leakage of 1.000 L/min at 18 s; found healthy"
    )
    assert cases[0].time == 1.5


@given(name=st.text(), message=st.text())
def test_whatever_a_test_is_called_and_says_the_file_is_xml(name: str, message: str) -> None:
    _, cases = written(replace(TEST, name=name, status=Status.ERROR, message=message))
    assert len(cases) == 1
