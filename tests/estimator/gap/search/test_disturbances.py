"""Where a model disagrees with a recording: the equation, the region, and what is discovered."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numba import njit

from estimator.gap.plant.additions import MEMORIES
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
from estimator.gap.prediction.sensitivities import Course, course_of
from estimator.gap.prediction.variables import Variable
from estimator.gap.search.disturbances import attribution
from estimator.gap.search.drift import drifts
from estimator.gap.search.explaining import Explaining
from estimator.gap.search.findings import CHANCE, MATERIAL
from estimator.gap.search.shapes import Shape, fine_shapes, hats
from estimator.gap.search.waves import promising

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
    input_units=("N",),
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
        "direction": Region("direction", "", lambda x, u: np.sign(x[:, 1]), ("", 1.0)),
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


FITTED = Variable("", "drag", 1.0, 0.0, 1e4, name="drag")


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


def _explaining(record: Record, pool: ThreadPoolExecutor, plant: Plant = SLED) -> Explaining:
    """Return what explains what a refit of the drag leaves."""
    fitter = Fitter(Predictor(plant), [record], pool)
    values = fitter.filtered(SLED.nominal).fit(SLED.nominal, [FITTED]).values
    return Explaining(fitter.filtered(values), values, [FITTED], 1.0)


def test_a_curve_is_explained_where_it_enters_by_what_it_depends_on(
    pool: ThreadPoolExecutor,
) -> None:
    explaining = _explaining(_moved(lambda x, v: 400.0 * v * abs(v)), pool)
    best = explaining.explanations()[0]
    assert best.where == ("force balance", "velocity", "")
    assert best.share > 0.8
    assert best.z > 5.0
    (simple,) = explaining.of(best.place, [Shape("velocity", "", "x |x|")])
    # Fewer coefficients predict what they were not fitted to as well as a table does.
    assert simple.gain > 0.98 * best.gain
    # To first order: it says how large the disturbance is to a tenth.
    assert simple.coefficients[0] == pytest.approx(400.0, rel=0.1)


def test_a_wave_along_the_stroke_is_told_with_its_pitch(pool: ThreadPoolExecutor) -> None:
    record = _moved(lambda x, v: 15.0 * np.sin(2.0 * np.pi * x / 0.02))
    best = _explaining(record, pool).explanations()[0]
    assert best.where == ("force balance", "position", "")
    assert best.shape.form == "wave"
    assert best.shape.at[0] == pytest.approx(0.02, rel=0.03)
    assert best.addition.values[0] == pytest.approx(15.0, rel=0.1)


def test_of_many_waves_those_that_explain_most_are_among_the_few_that_are_followed(
    pool: ThreadPoolExecutor,
) -> None:
    explaining = _explaining(_moved(lambda x, v: 15.0 * np.sin(2.0 * np.pi * x / 0.0217)), pool)
    (place,) = [each for each in explaining.places if each.name == "force balance"]
    along = explaining.attribution.along("position")
    shapes = fine_shapes("position", np.concatenate(along), turned=False)
    waves = [shape for shape in shapes if shape.form == "wave"]
    few = promising(explaining.attribution, place, waves, along)
    assert len(few) < len(waves) / 4
    best = max(explaining.of(place, waves), key=lambda each: each.gain)
    assert best.shape in few


def test_a_block_in_which_small_changes_grow_without_end_does_not_count(
    pool: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = _moved(lambda x, v: 400.0 * v * abs(v))
    whole = _explaining(record, pool)
    answers = Course.answers

    def broken(self: Course, *given: Any) -> Array:
        found = answers(self, *given)
        found[2000:2500] *= 1e5
        return found

    monkeypatch.setattr(Course, "answers", broken)
    explaining = _explaining(record, pool)
    blocks = len(whole.attribution.left()[0])
    assert len(explaining.attribution.left()[0]) in (blocks - 1, blocks - 2)
    (force,) = (each for each in explaining.places if each.name == "force balance")
    (simple,) = explaining.of(force, [Shape("velocity", "", "x |x|")])
    assert simple.share > 0.8
    assert simple.coefficients[0] == pytest.approx(400.0, rel=0.1)


def test_a_plant_that_names_no_direction_of_motion_is_explained_without_it(
    pool: ThreadPoolExecutor,
) -> None:
    regions = {name: each for name, each in SLED.regions.items() if name != "direction"}
    plant = replace(SLED, regions=regions)
    record = _moved(lambda x, v: 15.0 * np.sin(2.0 * np.pi * x / 0.02))
    explanations = _explaining(record, pool, plant).explanations()
    assert explanations[0].where == ("force balance", "position", "")
    assert "reading of position_m" in {each.place.name for each in explanations}
    assert not any(each.shape.times for each in explanations)


def test_nothing_predicts_what_it_was_not_fitted_to_where_there_is_noise_only(
    pool: ThreadPoolExecutor,
) -> None:
    explaining = _explaining(_moved(lambda x, v: 0.0), pool)
    found = explaining.explanations()
    of_values = [each.gain for each in found if each.shape.form not in MEMORIES]
    assert max(of_values) < CHANCE
    # A table fitted to all blocks would gain half a variance for each of its knots.
    assert np.mean(of_values) < 0.0
    # What follows a filtered state sees the filter's own errors too, but less than what matters.
    remembered = [each.gain for each in found if each.shape.form in MEMORIES]
    assert max(remembered) < MATERIAL * explaining.samples


def test_an_error_of_a_sensor_is_no_force(pool: ThreadPoolExecutor) -> None:
    found = _attributed(_moved(lambda x, v: 0.0, lambda x: 2e-3 * (x - 0.1) ** 2), pool)
    best = found.curves(1.0)[0]
    assert (best.equation, best.region) == ("reading of position_m", "position")


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
