"""The experiment's page says what was found, and all that is doubtful about it."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.friction.break_away import BreakAway
from estimator.friction.curve import FrictionCurve, FrictionEstimate
from estimator.friction.fit import PARAMETERS, StribeckFit
from estimator.friction.joint import joint_fit
from estimator.friction.samples import Spring
from estimator.friction.steady_strokes import SteadySpeed
from estimator.friction.stiction import NO_LEVEL, StictionLevel, Trend
from rig.plant import NOMINAL, Model
from rig.report.friction.experiment import experiment_page, remarks
from rig.runner.experiments.friction_experiment import FrictionExperiment

VALUES = np.array([1100.0, 2400.0, 0.04, 350.0, 60.0])
ERRORS = np.array([3.0, 90.0, 0.001, 5.0, 0.4])
FLAT = Trend(0.0, 5.0, False)
SPEEDS = (SteadySpeed(0.3, 1265.7, 1.0, True), SteadySpeed(0.05, 1500.0, 40.0, False))


def experiment(level: StictionLevel | None = None, *, seen: bool = True) -> FrictionExperiment:
    """Return an experiment on a rig that is the nominal model, with 60 N of asymmetry."""
    level = level or StictionLevel(2396.0, 1.0, 60.0, 1.0, 5e-5, FLAT, FLAT, 10)
    unseen = FrictionEstimate(None, None, "N", "more steady sliding")
    estimates = {
        name: FrictionEstimate(float(value), float(error), "N") if seen else unseen
        for name, value, error in zip(PARAMETERS, VALUES, ERRORS, strict=True)
    }
    fit = StribeckFit(VALUES, np.diag(ERRORS**2), 9.0, False)
    sliding = FrictionCurve(estimates, (), fit, 0.05, 0.5, 40, Spring(0.0, 0.0), 1e-3)
    places = tuple(
        (
            BreakAway(-1, place, -2336.0, 3.0, -1e-4, 2e-3),
            BreakAway(1, place, 2456.0, 3.0, 1e-4, 2e-3),
        )
        for place in np.linspace(0.03, 0.58, 10)
    )
    return FrictionExperiment(
        rig="bench",
        assumed=Model(),
        spring=Spring(0.0, 0.0),
        null_V=-0.05,
        sliding=sliding,
        speeds=SPEEDS,
        places=places,
        level=level,
        fit=joint_fit(sliding, level, SPEEDS, NOMINAL, 0.002),
        recordings=(),
    )


def reported(found: FrictionExperiment) -> str:
    return "\n".join(remarks(found))


def test_the_page_holds_figure_3_1_with_its_band_and_fetches_nothing() -> None:
    page = experiment_page(experiment(), "2020-01-01 00:00")
    assert "figure 3.1" in page
    for part in ('"fitted"', '"upper"', '"break_away"', '"places"', "Friction of bench"):
        assert part in page
    assert "<script src" not in page
    assert "NaN" not in page.partition('id="figures">')[2].partition("</script>")[0]


def test_a_good_experiment_raises_no_doubt() -> None:
    words = reported(experiment())
    assert "stiction measured: 2401" in words
    assert "does not depend on the position" in words
    assert "1 of 2 strokes were steady" in words
    assert "differ" not in words
    assert "misses" not in words


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"level_trend": Trend(200.0, 20.0, True)}, "stiction depends on the position: +200"),
        ({"offset_trend": Trend(900.0, 20.0, True)}, "tell it with --spring"),
        ({"level": 3200.0}, "friction does not fall exponentially"),
        ({"offset": 90.0}, "the law misses the points"),
    ],
)
def test_what_is_doubtful_is_said(changes: dict[str, object], words: str) -> None:
    level = experiment().level
    assert words in reported(experiment(replace(level, **changes)))  # type: ignore[arg-type]


def test_what_was_not_measured_is_said() -> None:
    assert "break-away: not measured" in reported(experiment(NO_LEVEL))
    unseen = experiment(seen=False)
    assert unseen.fit is None
    assert "not identifiable; needs more steady sliding" in reported(unseen)
    assert "not shown" in experiment_page(unseen, "2020-01-01 00:00")
