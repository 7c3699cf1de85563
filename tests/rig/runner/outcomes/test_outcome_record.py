"""An outcome comes back from the journal as it went in, bit for bit."""

import json
from math import inf, nan

import numpy as np
from hypothesis import given, strategies as st

from estimator.friction.curve import FrictionBin, FrictionCurve, FrictionEstimate
from estimator.friction.fit import StribeckFit
from estimator.friction.samples import Spring
from estimator.leaks.detection import Decision
from faults.campaign import OnFault
from rig.runner.outcomes.outcome import InjectedFault, Status, TestOutcome
from rig.runner.outcomes.outcome_record import outcome_of, record_of
from rig.runner.outcomes.reactions import FaultAction

floats = st.floats(allow_nan=False)
decisions = st.builds(
    Decision,
    verdict=st.sampled_from(["healthy", "external_leakage_1"]),
    onset_s=st.none() | floats,
    leak_m3_per_s=st.none() | floats,
    statistic=floats,
    threshold=floats,
    details=st.dictionaries(st.text(), floats, max_size=3),
    present_leaks=st.tuples(floats, floats, floats),
)
outcomes = st.builds(
    TestOutcome,
    name=st.text(),
    expect=st.just("healthy"),
    status=st.sampled_from(Status),
    seed=st.integers(0, 2**31),
    duration_s=floats,
    injected=st.lists(
        st.builds(InjectedFault, st.text(), floats, st.none() | floats, floats, st.booleans(),
                  st.none() | floats), max_size=2,
    ).map(tuple),
    decision=st.none() | decisions,
    message=st.text(),
    on_fault=st.sampled_from(OnFault),
    actions=st.lists(st.builds(FaultAction, floats, st.none() | floats, st.text()), max_size=2).map(
        tuple
    ),
    recording=st.none() | st.text(),
)  # fmt: skip


@given(outcome=outcomes)
def test_an_outcome_comes_back_as_it_was(outcome: TestOutcome) -> None:
    text = json.dumps(record_of(outcome), allow_nan=False)
    assert outcome_of(json.loads(text)) == outcome


def test_a_friction_curve_comes_back_with_what_is_not_known() -> None:
    fit = StribeckFit(np.array([1.0, nan, 3.0, 4.0, 5.0]), np.full((5, 5), inf), nan, True)
    curve = FrictionCurve(
        estimates={"viscous": FrictionEstimate(None, None, "N s/m", "a faster motion")},
        bins=(FrictionBin(0.1, 350.0, 4.0, 20),),
        fit=fit,
        slowest=None,
        fastest=0.6,
        strokes=4,
        spring=Spring(2e4, 0.22),
        lag_s=0.01,
    )
    outcome = TestOutcome("test", "healthy", Status.PASSED, 1, 40.0, friction=curve)
    back = outcome_of(json.loads(json.dumps(record_of(outcome), allow_nan=False))).friction
    assert back is not None
    assert back.spring == curve.spring
    assert back.estimates == curve.estimates
    assert back.bins == curve.bins
    np.testing.assert_array_equal(back.fit.values, fit.values)
    np.testing.assert_array_equal(back.fit.covariance, fit.covariance)
