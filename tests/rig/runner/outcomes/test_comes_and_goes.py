"""What is found of a leak that comes and goes is told in words and in JSON."""

import json
from dataclasses import replace

import pytest

from estimator.intermittent import Company, Episode, Intermittent
from estimator.leaks import Decision
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.wording import story
from rig.runner.outcomes import Status, TestOutcome, in_passing
from rig.runner.run_folder import returns_of

FLOW = 0.2 * LITRE_PER_MINUTE
EPISODES = tuple(Episode(20.0 + 10.0 * k, 22.0 + 10.0 * k, FLOW) for k in range(8))
GOES_WITH = Company("position", 1, 0.97, 0.002, 0.312)
FOUND = Intermittent(
    "external_leakage_1", 90.0, 14.4, 85.0, EPISODES, 8, 0.2, (0.17, 0.23), FLOW, 0.01 * FLOW, 1e-9,
    GOES_WITH,
)  # fmt: skip
DECISION = Decision("external_leakage_1", 20.0, FLOW, returns=FOUND)


@pytest.mark.parametrize(
    ("goes_with", "words"),
    [
        (None, ""),
        (GOES_WITH, ", where position is above 312 mm"),
        (Company("direction", -1, 0.9, 0.002), ", while the ram retracts"),
        (Company("time", 0, 0.9, 0.002, period_s=9.96), ", every 10.0 s"),
        (
            Company("pressure_1", -1, 0.9, 0.002, 7.04e6, ("direction",)),
            ", where pressure 1 is below 7.04 MPa (or as direction does)",
        ),
    ],
)
def test_it_is_told_in_words_how_often_and_with_what_it_opens(
    goes_with: Company | None, words: str
) -> None:
    found = replace(FOUND, goes_with=goes_with)
    (clause,) = in_passing(replace(DECISION, returns=found), ())
    assert clause == f"comes and goes, open 20 % of the time (17 to 23 %), 8 times{words}"


def test_of_a_leak_that_comes_and_goes_nobody_says_that_it_is_gone() -> None:
    ended = replace(DECISION, ended_s=88.0)
    assert in_passing(ended, ())[1] == "last open until 88.0 s"
    assert in_passing(replace(ended, returns=None), ()) == ["gone again at 88.0 s"]


def test_the_report_tells_it_of_the_leak_itself_and_other_faults_apart() -> None:
    ended = replace(DECISION, ended_s=88.0)
    test = TestOutcome("leak", "healthy", Status.FAILED, 1, 90.0, (), ended, recorded_s=90.0)
    told = story(test)
    assert "It comes and goes, open 20 % of the time" in told
    assert "It was last open until 88.0 s." in told
    assert "gone again" not in told
    assert "in passing" not in told


def test_json_has_its_openings() -> None:
    told = json.loads(json.dumps(returns_of(DECISION)))
    assert told["intermittent"] is True
    assert told["duty"] == 0.2
    assert told["duty_interval"] == [0.17, 0.23]
    assert told["openings"] == len(told["episodes"]) == 8
    assert told["episodes"][0]["start_s"] == 20.0
    assert told["episodes"][0]["leak_L_per_min"] == pytest.approx(0.2)
    assert told["goes_with"]["what"] == "position"
    assert told["goes_with"]["beyond"] == 0.312


def test_json_of_a_fault_that_stays_has_the_same_keys() -> None:
    told = returns_of(Decision("external_leakage_1", 20.0, FLOW))
    assert told.keys() == returns_of(DECISION).keys()
    assert told["intermittent"] is False
    assert told["episodes"] == []
