"""A drift of the encoder and the growth of a leak are told in words and in JSON."""

import json
from dataclasses import replace

import pytest

from estimator.encoder import EncoderDrift
from estimator.leaks import Decision, Growth
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.wording import story
from rig.runner.outcomes import Status, TestOutcome, in_passing, onset_shown
from rig.runner.run_folder import drift_of, leak_figures

SURE = EncoderDrift(2e-3, 3e-4, 20.0, 9.0, 5.5, 150.0)
OPEN = replace(SURE, could_also_be=("internal_leakage", "null_shift"))
DRIFTS = Decision("encoder_drift", 20.0, statistic=9.0, threshold=5.5, drift=SURE)
UNSURE = Decision("inconclusive", drift=OPEN)
GROWS = Decision(
    "internal_leakage",
    20.0,
    0.2 * LITRE_PER_MINUTE,
    growth=Growth(0.4 * LITRE_PER_MINUTE, 6e-3 * LITRE_PER_MINUTE,
                  0.3 * LITRE_PER_MINUTE / 60.0, 9e-3 * LITRE_PER_MINUTE / 60.0,
                  0.1 * LITRE_PER_MINUTE, 60.0),
)  # fmt: skip


def test_a_drift_is_told_with_its_rate() -> None:
    (clause,) = in_passing(DRIFTS, ())
    assert clause == "the encoder's reading runs away from the ram by +2.0 ± 0.6 mm/s"


def test_a_leak_that_grows_is_shown_without_an_onset() -> None:
    assert onset_shown(GROWS) is None
    assert onset_shown(replace(GROWS, growth=None)) == 20.0
    assert onset_shown(None) is None


def test_what_is_not_told_apart_is_named() -> None:
    (clause,) = in_passing(UNSURE, ())
    assert clause == (
        "may be encoder drift or internal leakage or null shift; "
        "a drift of the encoder would be +2.0 ± 0.6 mm/s"
    )


def test_a_leak_that_grows_is_told_with_its_flow_now() -> None:
    (clause,) = in_passing(GROWS, ())
    assert clause == (
        "grew from 0.100 to 0.400 ± 0.012 L/min within 60 s, "
        "and grows on by 0.300 ± 0.018 L/min a minute"
    )


def test_a_leak_that_has_grown_is_told_with_its_onset_and_without_a_rate() -> None:
    assert GROWS.growth is not None
    grown = replace(GROWS, growth=replace(GROWS.growth, since_s=20.0, grows_on=False))
    assert onset_shown(grown) == 20.0
    (clause,) = in_passing(grown, ())
    assert clause == "grew from 0.100 to 0.400 ± 0.012 L/min within 60 s"


@pytest.mark.parametrize(
    ("decision", "sentence"),
    [
        (DRIFTS, "The encoder's reading runs away from the ram by +2.0"),
        (GROWS, "It grew from 0.100"),
    ],
)
def test_the_report_tells_both(decision: Decision, sentence: str) -> None:
    test = TestOutcome("leak", "healthy", Status.FAILED, 1, 90.0, (), decision, recorded_s=90.0)
    assert sentence in story(test)


def test_json_has_the_drift_and_what_it_may_be() -> None:
    told = json.loads(json.dumps(drift_of(UNSURE)))
    assert told["could_also_be"] == ["encoder_drift", "internal_leakage", "null_shift"]
    assert told["encoder_drift_m_per_s"] == 2e-3
    assert drift_of(DRIFTS)["could_also_be"] == []
    assert drift_of(GROWS) == {
        "could_also_be": [],
        "encoder_drift_m_per_s": None,
        "encoder_drift_std_m_per_s": None,
    }


def test_json_has_the_growth() -> None:
    told = leak_figures(GROWS)
    assert told["leak_now_L_per_min"] == pytest.approx(0.4)
    assert told["growth_L_per_min_per_min"] == pytest.approx(0.3)
    assert told["growth_std_L_per_min_per_min"] == pytest.approx(9e-3)
    assert told["grew_from_L_per_min"] == pytest.approx(0.1)
    assert told["grew_within_s"] == 60.0
    assert told["grows_on"] is True
    assert leak_figures(DRIFTS)["grew_within_s"] is None
    assert leak_figures(DRIFTS)["leak_now_L_per_min"] is None
