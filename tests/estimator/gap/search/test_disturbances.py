"""Where a model disagrees with a recording: the equation, the region, and the term in symbols."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit

from estimator.gap.plant.interface import (
    READ,
    STEP,
    Array,
    Equation,
    Output,
    Parameter,
    Plant,
    Region,
    State,
)
from estimator.gap.plant.records import Record, made_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.results import Curve
from estimator.gap.prediction.sensitivities import course_of
from estimator.gap.prediction.variables import Variable
from estimator.gap.search.disturbances import attribution, hats, places_of
from estimator.gap.search.drift import drifts
from estimator.gap.search.findings import MOST_EFFECTS
from estimator.gap.verdict.judging import judge
from estimator.gap.verdict.unknown import find_unknown, in_symbols

TICK, MASS, DRAG = 1e-3, 10.0, 300.0
POSITION_NOISE, SPEED_NOISE = 1e-6, 1e-3


@njit(STEP, error_model="numpy")
def _step(state: Array, memory: Array, parameters: Array) -> None:
    force = memory[0] - parameters[0] * state[1]
    state[0] += 1e-3 * state[1]
    state[1] += 1e-3 / 10.0 * force


@njit(READ, error_model="numpy")
def _read(state: Array, memory: Array, parameters: Array, readings: Array) -> None:
    readings[0], readings[1] = state[0], state[1]


def _start(readings: Array, inputs: Array, values: Any) -> tuple[Array, Array]:
    return readings[0].copy(), np.array([1e-4, 1e-2])


SLED = Plant(
    name="sled",
    states=(State("position", "m", 1e-6, 1e-7), State("velocity", "m/s", 1e-5, 1e-4)),
    inputs=("force_N",),
    outputs=(
        Output("position_m", "m", POSITION_NOISE, shown=("um", 1e6), of=("position",)),
        Output("velocity_m_s", "m/s", SPEED_NOISE),
    ),
    parameters=(Parameter("drag", "N s/m", 0.0, 1e4),),
    nominal={"drag": DRAG},
    step=_step,
    read=_read,
    start=_start,
    effects={},
    nuisances=(),
    equations=(
        Equation(
            "force balance", "N", 1, lambda x, v: np.full(len(x), -TICK / MASS), ("N", 1.0),
            ("velocity", "position"),
        ),
    ),
    regions={
        "velocity": Region("velocity", "m/s", lambda x, u: x[:, 1], ("mm/s", 1e3), "v"),
        "position": Region("position", "m", lambda x, u: x[:, 0], ("mm", 1e3), "x", True),
    },
    steering=(),
    write=lambda *_: None,
)  # fmt: skip


def _moved(
    force: Callable[[float, float], float], error: Callable[[Array], Array] = np.zeros_like
) -> Record:
    """Return 12 s of a sled with a force against it, and an error of its position's reading."""
    generator = np.random.default_rng(1)
    count = 12000
    time = np.arange(count) * TICK
    pushed = 60.0 * np.sin(2.0 * np.pi * 0.31 * time) + 30.0 * np.sin(2.0 * np.pi * 1.3 * time)
    states = np.empty((count, 2))
    x, v = 0.1, 0.0
    for k in range(count):
        states[k] = x, v
        x, v = x + TICK * v, v + TICK / MASS * (pushed[k] - DRAG * v - force(x, v))
    readings = states + generator.normal(size=states.shape) * (POSITION_NOISE, SPEED_NOISE)
    readings[:, 0] += error(states[:, 0])
    return made_of("sled", pushed[:, None], readings, SLED)


@pytest.fixture(scope="module")
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as threads:
        yield threads


def _attributed(record: Record, pool: ThreadPoolExecutor) -> Any:
    filtered = Fitter(Predictor(SLED), [record], pool).filtered(SLED.nominal)
    return attribution(filtered, SLED.nominal, ())


def test_hats_add_up_to_one_everywhere() -> None:
    values = np.linspace(-2.0, 3.0, 101)
    assert hats(values, np.linspace(-1.0, 1.0, 9)).sum(1) == pytest.approx(np.ones(101))


def test_a_drag_that_grows_with_the_square_of_speed_is_found_there_in_newtons(
    pool: ThreadPoolExecutor,
) -> None:
    found = _attributed(_moved(lambda x, v: 400.0 * v * abs(v)), pool)
    best = found.curves(1.0)[0]
    assert (best.equation, best.region, best.unit) == ("force balance", "velocity", "N")
    assert best.share > 0.9
    # The outermost hats hold for what is beyond them too, and their neighbours make up for it.
    inner = slice(2, -2)
    expected = 400.0 * best.at * np.abs(best.at)
    # Straight lines between the middles miss a parabola by its curvature, the first order some
    # hundredths of a disturbance that has moved the course.
    bent = 800.0 * (best.at[1] - best.at[0]) ** 2 / 8.0 + 0.03 * np.abs(expected[inner])
    assert np.all(np.abs(best.values - expected)[inner] < 4.0 * best.errors[inner] + bent)
    unknown = in_symbols(found, places_of(SLED)[0], 1.0)
    assert unknown is not None
    assert unknown.terms[0].form == "x |x|"
    # To first order: it says how large the disturbance is to a tenth.
    assert unknown.coefficients[0] == pytest.approx(400.0, rel=0.1)
    assert "N/(m/s)^2 v |v|" in unknown.text(SLED)


def test_a_wave_along_the_stroke_is_told_with_its_pitch(pool: ThreadPoolExecutor) -> None:
    found = _attributed(_moved(lambda x, v: 15.0 * np.sin(2.0 * np.pi * x / 0.02)), pool)
    unknown = find_unknown(found, found.curves(1.0), 1.0)
    assert unknown is not None
    assert unknown.place.name == "force balance"
    assert unknown.terms[0].form == "wave"
    assert unknown.terms[0].at[0] == pytest.approx(0.02, rel=0.03)
    assert np.hypot(*unknown.coefficients[:2]) == pytest.approx(15.0, rel=0.1)


def test_an_error_of_a_sensor_is_no_force(pool: ThreadPoolExecutor) -> None:
    found = _attributed(_moved(lambda x, v: 0.0, lambda x: 2e-3 * (x - 0.1) ** 2), pool)
    best = found.curves(1.0)[0]
    assert (best.equation, best.region) == ("reading of position_m", "position")


def test_noise_has_no_terms(pool: ThreadPoolExecutor) -> None:
    found = _attributed(_moved(lambda x, v: 0.0), pool)
    assert all(in_symbols(found, place, 1.0) is None for place in places_of(SLED))


FITTED = Variable("drag", "", "drag", 1.0, 0.0, 1e4)


def _drifts(record: Record, pool: ThreadPoolExecutor) -> list[Curve]:
    filtered = Fitter(Predictor(SLED), [record], pool).filtered(SLED.nominal)
    fitted = filtered.fit(SLED.nominal, [FITTED])
    return drifts(filtered, fitted.values, [FITTED], 1.0)


def test_a_drag_that_grows_within_the_recording_is_a_parameter_that_drifts(
    pool: ThreadPoolExecutor,
) -> None:
    clock = iter(range(12000))
    (drift,) = _drifts(_moved(lambda x, v: 4.0 * next(clock) * TICK * v), pool)
    assert (drift.equation, drift.region, drift.unit) == ("drag", "time", "N s/m")
    slope = (drift.values[1] - drift.values[0]) / (drift.at[1] - drift.at[0])
    assert slope == pytest.approx(4.0, rel=0.1)
    assert drift.share > 0.8


def test_a_drag_that_stays_does_not_drift(pool: ThreadPoolExecutor) -> None:
    assert _drifts(_moved(lambda x, v: 30.0 * v), pool) == []


def test_the_linearised_course_answers_to_kicks_as_the_filter_does() -> None:
    record = _moved(lambda x, v: 0.0)
    predictor = Predictor(SLED)
    gains = predictor.filter(record, SLED.nominal)
    kicks = 1e-5 * np.sin(np.arange(len(record)) / 50.0)
    pushed = replace(record, inputs=record.inputs + MASS / TICK * kicks[:, None])
    base = predictor.innovations(record, gains, SLED.nominal)[0]
    changed = predictor.innovations(pushed, gains, SLED.nominal)[0] - base
    course = course_of(predictor, record, gains, SLED.nominal, (), np.arange(len(record)))
    answer = course.answers([1], kicks[:, None, None])[:, :, 0]
    assert answer == pytest.approx(changed, rel=1e-5, abs=1e-6 * float(np.abs(changed).max()))


def _found(before: float, after: float, named: bool, size: float = 200.0) -> Any:
    def fitted(cost: float) -> SimpleNamespace:
        return SimpleNamespace(cost=1000.0 * (1.0 + cost), values={"constant_force": size})

    effect = SimpleNamespace(effect="constant_force", per_reading=1.0, gain=9.0, bar=1.0, z=9.0)
    return SimpleNamespace(
        given=SimpleNamespace(values={"constant_force": 0.0}),
        refitted=fitted(before), fitted=fitted(after), samples=1000, floor=1.0,
        explained=1.0 - after / before, named=[effect] if named else [],
        variables=(Variable("constant_force", "value", "constant_force", 1.0, -5e3, 5e3),),
    )  # fmt: skip


def _curve(share: float) -> Curve:
    none = np.zeros(1)
    return Curve(
        "force balance", "position", none, none, none, "N", "m", ("N", 1.0), ("m", 1.0), 1e3, share
    )  # fmt: skip


@pytest.mark.parametrize(
    ("before", "after", "named", "share", "verdict"),
    [
        (5.0, 0.02, True, 0.9, "missing_effect"),
        (5.0, 0.6, True, 0.1, "missing_effect"),
        (5.0, 0.6, True, 0.9, "unknown_effect"),
        (5.0, 3.0, True, 0.5, "unknown_effect"),
        (5.0, 5.0, False, 0.5, "unknown_effect"),
        (0.005, 0.005, False, 0.9, "adequate"),
    ],
)
def test_names_that_leave_much_to_a_free_curve_are_not_the_cause(
    before: float, after: float, named: bool, share: float, verdict: str
) -> None:
    found = _found(before, after, named)
    assert judge(found, [_curve(share)], [], 0.0).verdict == verdict


def test_what_one_equation_lacks_is_of_this_rig_however_badly_it_is_predicted() -> None:
    found, channels = _found(80.0, 80.0, False), ["pressure_1_Pa", "pressure_2_Pa"]
    assert judge(found, [_curve(0.1)], channels, 80.0).verdict == "inconclusive"
    located = judge(found, [_curve(0.1)], channels, 80.0, located=0.6)
    assert located.verdict == "unknown_effect"


def test_names_that_do_not_explain_the_recordings_held_out_are_not_claimed() -> None:
    found = _found(5.0, 0.02, True)
    assert judge(found, [], [], 3.0, 5.0).verdict == "unknown_effect"
    assert judge(found, [], [], 0.5, 5.0).verdict == "missing_effect"


@pytest.mark.parametrize(
    ("size", "after", "verdict"),
    [
        (5e3, 0.6, "unknown_effect"),
        (-5e3, 0.6, "unknown_effect"),
        (5e3, 0.005, "missing_effect"),
        (4e3, 0.6, "missing_effect"),
    ],
)
def test_the_most_that_is_plausible_is_no_finding_if_it_leaves_much(
    size: float, after: float, verdict: str
) -> None:
    found = _found(5.0, after, True, size)
    assert judge(found, [], [], 0.0).verdict == verdict
    # What a motion held out that shows it bears out is the cause all the same.
    assert judge(found, [], [], 0.05, 50.0).verdict == "missing_effect"


@pytest.mark.parametrize(
    ("names", "ahead", "verdict"),
    [
        (1, (20.0, 1.0), "missing_effect"),
        (1, (20.0, 12.0), "unknown_effect"),
        (1, (3.0, 2.0), "missing_effect"),
        (MOST_EFFECTS, (1000.0, 20.0), "unknown_effect"),
        (MOST_EFFECTS, (1000.0, 2.0), "missing_effect"),
    ],
)
def test_names_that_leave_the_gap_over_the_horizon_open_are_not_claimed(
    names: int, ahead: tuple[float, float], verdict: str
) -> None:
    found = _found(5.0, 0.02, True)
    found.named = names * found.named
    assert judge(found, [], [], 0.0, ahead=ahead).verdict == verdict


def test_a_gap_that_twins_have_too_speaks_against_no_name() -> None:
    found, ahead = _found(5.0, 0.02, True), (9.0, 8.0)
    assert judge(found, [], [], 0.0, ahead=ahead, scatter=1.0).verdict == "unknown_effect"
    assert judge(found, [], [], 0.0, ahead=ahead, scatter=3.0).verdict == "missing_effect"


def test_recordings_held_out_that_no_finding_explains_support_no_verdict() -> None:
    found = _found(0.005, 0.005, False)
    assert judge(found, [_curve(0.9)], [], 5.0).verdict == "inconclusive"
    assert judge(found, [_curve(0.9)], [], 0.05).verdict == "adequate"
