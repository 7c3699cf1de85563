"""Cases with segments follow a campaign's setpoint; leaks with a profile grow as it says."""

from dataclasses import replace

import numpy as np
import pytest

from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from rig.lanes import LANES
from rig.plant.integrator import TICK
from rig.sweep.asked import columns_told
from rig.sweep.drawing import draw
from rig.sweep.group import Group, setting_of
from rig.sweep.run_cases import judge_cases, run_thesis7

TEXT = """\
name: grows
rig: ideal
filter: thesis-7
cases: 16
duration: 20 s
leaks:
  healthy: 0
  profile:
    - {at: 15.5 s, flow: 0.5 L/min}
    - {at: {uniform: [15.6 s, 15.7 s]}, ramp: 0.1 s, flow: {uniform: [1 L/min, 2 L/min]}}
criteria:
  - {figure: rms_error, at_most: 20 mm}
  - {figure: peak, channel: pressure_1_Pa, at_most: 13 MPa}
motions:
  - name: work
    segments:
      - {name: wave, setpoint: {type: sine, mean: 0.3 m, amplitude: 0.05 m, frequency: 0.5 Hz}, cycles: 3}
      - loop: 2
        segments:
          - {hold: 1 s}
          - {setpoint: {type: steps, levels: [0.3 m, 0.35 m, 0.3 m], hold: 1 s}, duration: 3 s}
  - {type: sine, mean: 0.3 m, amplitude: 0.05 m, frequency: 0.5 Hz}
"""  # noqa: E501 (as a user would write it)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    file = tmp_path_factory.mktemp("sweep") / "grows.yaml"
    file.write_text(TEXT)
    return load_sweep(file)


def test_a_lane_is_asked_for_the_setpoint_of_its_segments(sweep: Sweep) -> None:
    cases = draw(sweep, 0, 16)
    group = Group(setting_of(sweep), cases, np.arange(LANES))
    (work, _) = sweep.motions
    assert work.sequence is not None
    expected = work.sequence.sample(np.arange(sweep.ticks) * TICK)
    segmented = cases.motions.kind[:LANES] == 0
    assert 0 < segmented.sum() < LANES
    table = group.lanes.table
    assert table is not None
    for lane in np.flatnonzero(segmented):
        np.testing.assert_array_equal(table[:, lane], expected)
    # A case with another motion beside them has that of its own.
    other = int(np.flatnonzero(~segmented)[0])
    assert np.ptp(table[:, other]) == pytest.approx(0.1, rel=1e-3)
    assert group.motions.begins()[0] == pytest.approx(table[0, 0])


def test_a_leak_grows_along_its_profile(sweep: Sweep) -> None:
    cases = draw(sweep, 0, 16)
    growth = cases.growth(np.arange(16), sweep.ticks)
    assert growth is not None
    assert not growth[:15_500].any()
    np.testing.assert_allclose(growth[15_900:], 1.0, rtol=1e-12)
    begin_s, first, last = (
        np.asarray(cases.columns[name].values, np.float64)
        for name in ("level_2_s", "level_1_coefficient", "coefficient")
    )
    np.testing.assert_allclose(growth[15_550], first / last, rtol=1e-12)
    middle = np.round((begin_s + 0.05) * 1000.0).astype(np.intp)
    halfway = 0.5 * (1.0 + first / last)
    np.testing.assert_allclose(growth[middle, np.arange(16)], halfway, atol=0.01)
    assert np.all(cases.onset_s == 15.5)


def test_levels_are_drawn_for_each_case_and_do_not_change_what_else_is_drawn(sweep: Sweep) -> None:
    cases = draw(sweep, 0, 16)
    assert np.unique(cases.columns["coefficient"].values).size == 16
    assert sweep.leaks is not None
    plain = draw(replace(sweep, leaks=replace(sweep.leaks, profile=())), 0, 16)
    np.testing.assert_array_equal(plain.faults, cases.faults)
    np.testing.assert_array_equal(plain.motions.sines, cases.motions.sines)
    assert plain.growth(np.arange(16), sweep.ticks) is None
    later = draw(sweep, 8, 8)
    np.testing.assert_array_equal(
        later.columns["coefficient"].values, cases.columns["coefficient"].values[8:]
    )


@pytest.mark.long
def test_both_filters_ask_the_same_cases_and_keeping_readings_changes_no_verdict(
    sweep: Sweep,
) -> None:
    setting, cases = setting_of(sweep), draw(sweep, 0, LANES)
    by_thesis = judge_cases(setting, cases)
    by_product = judge_cases(setting_of(replace(sweep, filter_name="product")), cases)
    asked = columns_told(setting.asked)
    assert {"figure_rms_error", "met_rms_error", "passed"} <= set(asked)
    for name in asked:
        found, other = (each[name].astype(np.float64) for each in (by_thesis, by_product))
        np.testing.assert_allclose(found, other, rtol=1e-9)
    true, other = (
        each["leak_true_m3_per_s"].astype(np.float64) for each in (by_thesis, by_product)
    )
    np.testing.assert_allclose(true, other, rtol=1e-9)
    # While the ram rests little flows: between the chambers there is no pressure then, and a
    # chamber that leaks to the outside is soon empty.
    moving = (cases.motions.kind == 1) & (cases.faults != "internal_leakage")
    flow = true[moving] * 6e4
    assert np.all((flow > 0.5) & (flow < 2.5))
    at = np.arange(LANES)
    kept = Group(setting, cases, at)
    np.testing.assert_array_equal(
        run_thesis7(kept, kept.room()), run_thesis7(Group(setting, cases, at))
    )


@pytest.mark.long
def test_a_profile_that_jumps_to_its_size_is_a_leak_without_a_profile(sweep: Sweep) -> None:
    leaks = sweep.leaks
    assert leaks is not None
    flat = replace(leaks, profile=leaks.profile[:1], size=leaks.profile[0].size)
    profile = replace(sweep, leaks=flat)
    cases = draw(profile, 0, LANES)
    at_once = replace(cases, profile=None)
    setting, at = setting_of(profile), np.arange(LANES)
    np.testing.assert_array_equal(
        run_thesis7(Group(setting, cases, at)), run_thesis7(Group(setting, at_once, at))
    )
