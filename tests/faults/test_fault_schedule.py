"""How faults come and go over a test, as the plant receives them."""

import pickle
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

from faults.bypass import NOMINAL_BYPASSES, bore_coefficient
from faults.schedule import Fault, FaultError, FaultSchedule, linked
from faults.verdict import FAULT_KINDS, LEAK_KINDS
from rig.plant.faults import FAULT_COLUMNS

PERIOD = 1e-3
INTERNAL = FAULT_COLUMNS.index("internal_leakage")
TICKS = 10_000

seconds = st.floats(0.0, 4.0)


@st.composite
def leaks(draw: st.DrawFn) -> Fault:
    kind = draw(st.sampled_from(FAULT_KINDS))
    linear = kind in LEAK_KINDS and draw(st.booleans())
    largest = 1e13 if kind == "return_blockage" else 1e-11 if linear else 5e-8
    at = draw(seconds)
    return Fault(
        kind,
        coefficient=largest * draw(st.floats(1e-6, 1.0)),
        linear=linear,
        at_s=at,
        until_s=at + draw(st.floats(0.01, 5.0) | st.just(inf)),
        ramp_s=draw(st.just(0.0) | seconds),
        travel_s=draw(st.just(0.0) | seconds),
        ball_coefficient=None if linear else draw(st.none() | st.floats(6e-8, 1e-5)),
    )


def column(faults: list[Fault], name: str, n_ticks: int = TICKS) -> np.ndarray:
    table = FaultSchedule(faults).table(n_ticks, PERIOD)
    assert table.shape == (n_ticks, len(FAULT_COLUMNS))
    assert table.dtype == np.float64
    return table[:, FAULT_COLUMNS.index(name)]


@given(leaks())
def test_a_fault_lies_between_nothing_and_what_was_asked(fault: Fault) -> None:
    acting = column([fault], fault.column)
    assert acting.min() >= 0.0
    assert acting.max() <= fault.coefficient


@given(leaks())
def test_a_fault_acts_within_its_time_only(fault: Fault) -> None:
    time = PERIOD * np.arange(TICKS)
    table = FaultSchedule([fault]).table(TICKS, PERIOD)
    outside = (time < fault.at_s - 1e-9) | (time > fault.end_s + 1e-9)
    assert not np.any(table[outside])
    others = [name for name in FAULT_COLUMNS if name != fault.column]
    assert not np.any(table[:, [FAULT_COLUMNS.index(name) for name in others]])


@given(leaks())
def test_a_fault_grows_until_it_is_to_end_and_only_shrinks_after(fault: Fault) -> None:
    time = PERIOD * np.arange(TICKS)
    acting = column([fault], fault.column)
    tolerance = 1e-12 * fault.coefficient
    assert np.all(np.diff(acting[time < fault.until_s - 1e-9]) >= -tolerance)
    if fault.ramp_s == 0.0:
        assert np.all(np.diff(acting[time >= fault.until_s - 1e-9]) <= tolerance)


@given(leaks())
def test_a_fault_left_alone_reaches_what_was_asked(fault: Fault) -> None:
    if fault.until_s == inf:
        reached = column([fault], fault.column)[-1]
        assert reached == pytest.approx(fault.coefficient, rel=1e-9)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_a_fault_without_travel_begins_and_ends_on_its_tick(kind: str) -> None:
    # 0.1 + 0.2 and 3 * 0.2 come out a little late, as times computed by a campaign do.
    acting = column([Fault(kind, 1e-9, at_s=0.1 + 0.2, until_s=3 * 0.2)], kind)
    assert np.flatnonzero(acting).tolist() == list(range(300, 600))
    np.testing.assert_allclose(acting[300:600], 1e-9, rtol=1e-12)


def test_a_leak_appears_early_in_the_travel_of_its_ball() -> None:
    fault = Fault("external_leakage_1", 4e-9, at_s=1.0, travel_s=1.0)
    acting = column([fault], "external_leakage_1")
    assert acting[1000] == 0.0
    assert 0.0 < acting[1005] < 0.9 * 4e-9
    assert acting[1200] > 0.99 * 4e-9
    assert acting[2000] == pytest.approx(4e-9, rel=1e-12)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.5, 1.0])
def test_the_schedule_passes_what_the_bypass_does_at_the_same_ball_position(share: float) -> None:
    bypass = NOMINAL_BYPASSES["supply_leakage"]
    wanted = 8e-8
    fault = Fault(
        "supply_leakage",
        wanted,
        at_s=1.0,
        travel_s=bypass.ball_travel_s,
        ball_coefficient=bypass.ball_coefficient,
    )
    acting = column([fault], "supply_leakage")[1000 + round(500 * share)]
    assert acting == pytest.approx(bypass.effective(bypass.needle_opening_for(wanted), share))


def test_a_ball_shut_before_it_was_open_closes_from_where_it_was() -> None:
    fault = Fault("internal_leakage", 1e-8, at_s=1.0, until_s=1.4, travel_s=1.0)
    position = fault.ball_position(np.array([1.0, 1.3, 1.4, 1.5, 1.8, 1.9]))
    np.testing.assert_allclose(position, [0.0, 0.3, 0.4, 0.3, 0.0, 0.0], atol=1e-12)
    assert fault.end_s == pytest.approx(1.8)


def test_a_ramped_leak_grows_in_proportion_to_time() -> None:
    acting = column([Fault("external_leakage_2", 4e-9, at_s=2.0, ramp_s=4.0)], "external_leakage_2")
    np.testing.assert_allclose(
        acting[[3000, 4000, 6000, 9000]], 4e-9 * np.array([0.25, 0.5, 1, 1]), rtol=1e-4
    )


def test_a_linear_leak_acts_on_its_own_column() -> None:
    fault = Fault("internal_leakage", 2e-12, linear=True, at_s=5.0)
    assert column([fault], "internal_leakage_linear")[-1] == 2e-12
    assert not np.any(column([fault], "internal_leakage"))


def test_several_faults_act_at_once() -> None:
    faults = [
        Fault("external_leakage_1", 4e-9, at_s=2.0),
        Fault("return_blockage", 1e12, at_s=1.0, until_s=6.0, travel_s=0.5),
        Fault("external_leakage_1", 2e-12, linear=True, at_s=3.0),
    ]
    last = FaultSchedule(faults).table(5_000, PERIOD)[-1]
    expected = {
        "external_leakage_1": 4e-9,
        "external_leakage_1_linear": 2e-12,
        "return_blockage": 1e12,
    }
    np.testing.assert_allclose(last, [expected.get(name, 0.0) for name in FAULT_COLUMNS])


def test_a_bypass_can_be_opened_again_with_another_leak() -> None:
    schedule = FaultSchedule(
        [
            Fault("internal_leakage", 8e-9, at_s=6.0),
            Fault("internal_leakage", 4e-9, at_s=1.0, until_s=3.0, travel_s=0.5),
        ]
    )
    acting = schedule.table(TICKS, PERIOD)[:, FAULT_COLUMNS.index("internal_leakage")]
    np.testing.assert_allclose(acting[[2000, 4000, 7000]], [4e-9, 0.0, 8e-9], rtol=1e-9)
    assert [fault.at_s for fault in schedule.faults] == [1.0, 6.0]


def test_a_healthy_test_injects_nothing() -> None:
    assert not np.any(FaultSchedule().table(100, PERIOD))


@given(st.lists(leaks(), max_size=1), st.integers(0, 5_000))
def test_a_longer_test_repeats_a_shorter_one(faults: list[Fault], n_ticks: int) -> None:
    schedule = FaultSchedule(faults)
    np.testing.assert_array_equal(
        schedule.table(n_ticks, PERIOD), schedule.table(TICKS, PERIOD)[:n_ticks]
    )


def test_one_bypass_cannot_hold_two_leaks() -> None:
    first = Fault("internal_leakage", 4e-9, at_s=1.0, until_s=3.0, travel_s=0.5)
    with pytest.raises(FaultError, match=r"internal_leakage at_s: 3.4 is before .*3.5 s"):
        FaultSchedule([Fault("internal_leakage", 8e-9, at_s=3.4), first])
    second = Fault("internal_leakage", 8e-9, at_s=3.5)
    assert FaultSchedule([second, first]).faults == (first, second)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"kind": "healthy", "coefficient": 1e-9}, ["kind"]),
        ({"kind": "return_blockage", "coefficient": 1e12, "linear": True}, ["linear"]),
        ({"kind": "internal_leakage", "coefficient": 0.0}, ["coefficient"]),
        ({"kind": "internal_leakage", "coefficient": nan}, ["coefficient"]),
        ({"kind": "internal_leakage", "coefficient": 9e-7}, ["coefficient"]),
        ({"kind": "internal_leakage", "coefficient": 1e-8, "linear": True}, ["coefficient"]),
        ({"kind": "return_blockage", "coefficient": 1e15}, ["coefficient"]),
        (
            {
                "kind": "internal_leakage",
                "coefficient": 1e-9,
                "at_s": -1.0,
                "until_s": -2.0,
                "ramp_s": nan,
                "travel_s": inf,
            },
            ["at_s", "ramp_s", "travel_s", "until_s"],
        ),
        ({"kind": "internal_leakage", "coefficient": 1e-9, "until_s": nan}, ["until_s"]),
        (
            {"kind": "internal_leakage", "coefficient": 1e-9, "ball_coefficient": nan},
            ["ball_coefficient"],
        ),
    ],
)
def test_a_fault_that_cannot_be_injected_is_refused_with_every_reason(
    values: dict[str, object], named: list[str]
) -> None:
    with pytest.raises(FaultError) as error:
        Fault(**values)  # type: ignore[arg-type]
    assert [problem.field for problem in error.value.problems] == named


def test_a_leak_larger_than_its_ball_valve_is_refused() -> None:
    small = bore_coefficient(1e-3)
    with pytest.raises(FaultError, match="larger ball valve"):
        Fault("supply_leakage", 1.01 * small, ball_coefficient=small)
    assert Fault("supply_leakage", 0.99 * small, ball_coefficient=small).coefficient < small


def test_a_refusal_survives_the_way_back_from_a_worker_process() -> None:
    with pytest.raises(FaultError) as error:
        Fault("internal_leakage", 0.0)
    copy = pickle.loads(pickle.dumps(error.value))
    assert type(copy) is FaultError
    assert str(copy) == str(error.value)
    assert copy.problems == error.value.problems


# Faults that meet at one place


def growing() -> tuple[Fault, ...]:
    first = Fault("internal_leakage", 2e-9, at_s=1.0, until_s=2.0, travel_s=0.5)
    second = Fault("internal_leakage", 4e-9, at_s=2.0, until_s=4.0, travel_s=0.5, ramp_s=1.0)
    return first, second


def test_a_fault_that_begins_as_another_ends_goes_on_from_its_size_with_an_open_ball() -> None:
    table = FaultSchedule(growing()).table(5000, 1e-3)[:, INTERNAL]
    assert table[1999] == table[2000] == pytest.approx(2e-9)
    assert 2e-9 < table[2500] < 4e-9
    assert table[3500] == pytest.approx(4e-9)
    assert (np.diff(table[1000:4000]) >= 0.0).all()
    assert table[4600] == 0.0


def test_linking_faults_twice_changes_nothing_and_those_apart_stay_as_they_are() -> None:
    once = linked(growing())
    assert linked(once) == once
    assert (once[0].goes_on, once[1].follows) == (True, 2e-9)
    apart = growing()[0], replace(growing()[1], at_s=2.5)
    assert linked(apart) == apart


def test_a_leak_that_shrinks_never_falls_below_its_new_size() -> None:
    first, second = growing()
    table = FaultSchedule((first, replace(second, coefficient=1e-9))).table(5000, 1e-3)
    assert table[3500, INTERNAL] == pytest.approx(1e-9)
    assert table[2000:4000, INTERNAL].min() >= 1e-9 * (1.0 - 1e-12)


def test_a_linear_leak_goes_on_too() -> None:
    first = Fault("internal_leakage", 1e-12, linear=True, at_s=1.0, until_s=2.0)
    second = Fault("internal_leakage", 2e-12, linear=True, at_s=2.0, ramp_s=1.0)
    column = FAULT_COLUMNS.index("internal_leakage_linear")
    table = FaultSchedule((first, second)).table(4000, 1e-3)[:, column]
    assert table[[1500, 2000, 2500, 3500]].tolist() == pytest.approx([1e-12, 1e-12, 1.5e-12, 2e-12])
