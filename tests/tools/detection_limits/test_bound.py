"""The bound on a leak's flow is the information that the samples carry, no less."""

from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.flow import FlowAccount
from estimator.accounts.nuisances import NUISANCES
from estimator.filters.product_model import STATE_COUNT, predict_product
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from tools.detection_limits.bound import budgeted_noise, exact_noise, flow_bound
from tools.detection_limits.courses import Course, follow, setpoints
from tools.detection_limits.recursion import advance_covariance, observe
from tools.detection_limits.weaknesses import TOLERANCE, inflows, known

Array = NDArray[np.float64]

WINDOWS: Final = (0.5, 1.0, 2.0)
ONSET_S: Final = 2.0


@pytest.fixture(scope="module")
def sine() -> Course:
    return follow("sine", NOMINAL, setpoints(6002)["sine, 0.1 m at 0.5 Hz"])


def test_a_constant_that_is_read_n_times_is_known_to_a_root_of_n_better() -> None:
    covariance, gain = np.array([[1e12]]), np.empty(1)
    for _ in range(50):
        observe(covariance, 0, -1, 4.0, gain)
    assert covariance[0, 0] == pytest.approx(4.0 / 50)


def test_a_slope_is_known_as_well_as_a_straight_line_through_the_samples_tells() -> None:
    samples, variance = 40, 9.0
    covariance = np.diag([1e12, 1e12])
    rows, product, gain = np.array([[1.0, 1.0]]), np.empty((1, 2)), np.empty(2)
    for k in range(samples):
        if k:
            advance_covariance(covariance, rows, product)
        observe(covariance, 0, -1, variance, gain)
    assert covariance[1, 1] == pytest.approx(12.0 * variance / (samples * (samples**2 - 1.0)))


def test_a_bias_of_the_reading_is_told_from_the_state_by_what_is_believed_of_it_alone() -> None:
    covariance, gain = np.diag([1e12, 0.25]), np.empty(2)
    for _ in range(1000):
        observe(covariance, 0, 1, 1e-6, gain)
    assert covariance[0, 0] == pytest.approx(0.25, rel=1e-3)


@pytest.mark.long
def test_without_noise_of_the_model_the_bound_is_that_of_all_samples_at_once(sine: Course) -> None:
    """Sensitivities by running the model itself from shifted starts, in place of the recursion."""
    ticks, onset, leak = 600, 200, 7
    noise = exact_noise(sine)._replace(load=0.0)
    scale = np.array([1e-6, 1e4, 1e4, 1e-5, 1e-3, 1e-4, 10.0, 1e-10])
    loose = np.array([1e-4, 1e6, 1e6, 1e-2, 1.0, 0.1, 1e4, np.inf])
    unused = np.empty((6, STATE_COUNT))
    par = sine.parameters

    def outputs(shift: Array) -> Array:
        x = np.zeros(STATE_COUNT)
        x[:6] = sine.states[0, [0, 2, 3, 4, 5, 1]]
        x[6] = par.piston_area * (x[1] - x[2])
        x[:7] += shift[:7]
        seen = np.empty((ticks, 4))
        for k in range(ticks):
            if k:
                x[leak] = shift[7] if k > onset else 0.0
                predict_product(x, sine.command[k - 1], par.supply_pressure, par, unused)
            seen[k] = x[[0, 3, 1, 2]]
        return seen / np.sqrt([noise.spool, noise.position, noise.pressure, noise.pressure])

    slopes = [
        (outputs(step) - outputs(-step)).ravel() / (2.0 * size)
        for step, size in zip(np.diag(scale), scale, strict=True)
    ]
    sensitivity = np.array(slopes).T * scale
    information = sensitivity.T @ sensitivity + np.diag((scale / loose) ** 2)
    deviation = scale[7] * np.sqrt(np.linalg.inv(information)[7, 7])
    window = (ticks - 1 - onset) * TICK
    found = flow_bound(sine, noise, onset * TICK, [window], weaknesses=())
    root = np.sqrt(sine.states[onset:ticks, 2]).mean()
    # The load held still moves the run a little away from the sine it is linearised along.
    assert found.flow[0, 0] == pytest.approx(deviation * root, rel=0.1)


@pytest.mark.long
def test_what_is_known_grows_with_the_window(sine: Course) -> None:
    bound = flow_bound(sine, exact_noise(sine), ONSET_S, WINDOWS)
    assert (np.diff(bound.flow, axis=1) < 0.0).all()
    assert (bound.flow > 0.0).all()


@pytest.mark.long
def test_nothing_unknown_helps(sine: Course) -> None:
    noise = exact_noise(sine)
    without = flow_bound(sine, noise, ONSET_S, WINDOWS, weaknesses=())
    together = flow_bound(sine, noise, ONSET_S, WINDOWS)
    for weakness in known(sine):
        beside = flow_bound(sine, noise, ONSET_S, WINDOWS, weaknesses=(weakness,))
        assert (beside.flow >= without.flow * (1.0 - 1e-9)).all(), weakness
        assert (beside.flow <= together.flow * (1.0 + 1e-9)).all(), weakness


@pytest.mark.long
def test_the_bound_has_every_weakness_that_the_detector_allows_for(sine: Course) -> None:
    assert known(sine) == tuple(nuisance.name for nuisance in NUISANCES)


@pytest.mark.long
def test_a_sensor_helps_and_a_model_that_may_be_wrong_does_not(sine: Course) -> None:
    budgeted = flow_bound(sine, budgeted_noise(sine), ONSET_S, WINDOWS)
    blind = flow_bound(sine, budgeted_noise(sine), ONSET_S, WINDOWS, spool_sensor=False)
    poorer = flow_bound(sine, exact_noise(sine), ONSET_S, WINDOWS, supply_sensor=False)
    exact = flow_bound(sine, exact_noise(sine), ONSET_S, WINDOWS)
    assert (exact.flow < budgeted.flow).all()
    assert (budgeted.flow < blind.flow).all()
    assert (exact.flow < poorer.flow).all()


@pytest.mark.long
def test_a_rarer_false_alarm_or_a_surer_find_takes_a_larger_leak(sine: Course) -> None:
    bound = flow_bound(sine, exact_noise(sine), ONSET_S, WINDOWS)
    assert (bound.smallest(1.0, 0.95) > bound.smallest(100.0, 0.95)).all()
    assert (bound.smallest(1.0, 0.95) > bound.smallest(1.0, 0.5)).all()


@pytest.mark.long
def test_the_inflows_of_the_weaknesses_are_those_that_the_oil_accounts_expect(
    sine: Course,
) -> None:
    states = sine.states[500:1001]
    blocks = FlowAccount(sine.parameters).add(
        np.array([np.arange(501.0) * TICK, *states.T[[0, 2, 3, 4]], np.ones(501), [np.nan] * 501])
    )
    expected = inflows(sine)
    for index, nuisance in enumerate(NUISANCES):
        if nuisance.name not in expected:
            continue
        # What flows in unseen is missing the other way round.
        entered = -TOLERANCE[nuisance.name] * expected[nuisance.name][500:1000].mean(axis=0)
        assert blocks[0].nuisances[:, index] == pytest.approx(
            entered, rel=0.02, abs=1e-4 * LITRE_PER_MINUTE
        ), nuisance.name


@pytest.mark.long
def test_a_dry_chamber_has_no_bound(sine: Course) -> None:
    dry = Course("dry", sine.parameters, sine.command, sine.states * [1, 1, 1e-3, 1, 1, 1, 1, 1, 1])
    with pytest.raises(ValueError, match="dry: a chamber is as low as"):
        flow_bound(dry, exact_noise(dry), ONSET_S, WINDOWS)


@pytest.mark.long
def test_a_course_that_is_too_short_is_refused(sine: Course) -> None:
    with pytest.raises(ValueError, match="ends before tick"):
        flow_bound(sine, exact_noise(sine), ONSET_S, [10.0])
