"""The report's friction panel: over velocity, beside the model's curve, and frank."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.friction.curve import FrictionBin, FrictionCurve, FrictionEstimate
from estimator.friction.fit import NO_FIT, PARAMETERS, StribeckFit
from estimator.friction.samples import Spring
from rig.plant import NOMINAL, Model
from rig.recording import Recording
from rig.report.friction.page import FrictionRun, friction, friction_page, shown
from rig.report.panel import TestData
from rig.runner.outcomes.outcome import Status, TestOutcome

VALUES = np.array([1100.0, 2400.0, 0.04, 350.0, 60.0])
UNITS = ("N", "N", "m/s", "N s/m", "N")
CURVE = FrictionCurve(
    {
        name: FrictionEstimate(value, 0.01 * value, unit)
        for name, value, unit in zip(PARAMETERS, VALUES, UNITS, strict=True)
    },
    (FrictionBin(-0.2, -1130.0, 9.0, 40), FrictionBin(0.2, 1250.0, 9.0, 40)),
    StribeckFit(VALUES, np.diag((0.01 * VALUES) ** 2), 9.0, False),
    0.05,
    0.5,
    12,
    Spring(0.0, 0.0),
    1.2e-3,
)
NOTHING = FrictionEstimate(None, None, "N", "more steady sliding: a sine")
UNSEEN = replace(
    CURVE, estimates=dict.fromkeys(PARAMETERS, NOTHING), bins=(), fit=NO_FIT, slowest=None,
    fastest=None, strokes=0,
)  # fmt: skip


def data(curve: FrictionCurve | None) -> TestData:
    outcome = TestOutcome("t", "healthy", Status.PASSED, 1, 20.0, friction=curve)
    return TestData(outcome, Recording({"time_s": np.arange(3.0)}), "product", NOMINAL)


def test_friction_is_drawn_over_velocity_beside_the_models() -> None:
    panel = friction(data(CURVE))
    assert panel is not None
    assert [trace.name for trace in panel.traces] == ["model", "fitted", "medians, by velocity"]
    assert panel.figure["across"] == "mm/s"
    _, fitted, medians = panel.traces
    assert np.nanmin(np.abs(fitted.time_s)) == pytest.approx(50.0)
    assert medians.values == pytest.approx([-1130.0, 1250.0])
    assert "coulomb 1100 \u00b1 22 N" in panel.caption


@pytest.mark.parametrize("curve", [None, UNSEEN])
def test_without_steady_sliding_there_is_no_panel(curve: FrictionCurve | None) -> None:
    assert friction(data(curve)) is None


def test_what_is_not_known_is_not_drawn_as_a_curve() -> None:
    unknown = replace(UNSEEN, bins=CURVE.bins, slowest=0.05, fastest=0.5)
    panel = friction(data(unknown))
    assert panel is not None
    assert [trace.name for trace in panel.traces] == ["model", "medians, by velocity"]
    assert "not identifiable; needs more steady sliding" in panel.caption


def test_a_value_has_the_digits_its_interval_warrants() -> None:
    assert shown(FrictionEstimate(1098.23, 1.9, "N")) == "1098.2 \u00b1 3.7"
    assert shown(FrictionEstimate(0.04094, 0.00066, "m/s")) == "0.0409 \u00b1 0.0013"
    assert shown(FrictionEstimate(2346.0, 52.0, "N")) == "2346 \u00b1 102"
    assert shown(NOTHING) == "not shown"


def test_names_on_the_page_cannot_be_markup() -> None:
    run = FrictionRun("a.csv", "<b>evil</b>", None, CURVE)
    page = friction_page([run, replace(run, curve=UNSEEN)], Model())
    assert "<b>evil" not in page
    assert "not known, they show no parameter in common" in page
