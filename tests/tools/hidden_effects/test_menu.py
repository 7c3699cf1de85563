"""Each hidden effect does what the catalogue says of it."""

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model
from tests.tools.hidden_effects.test_physics import ran
from tools.hidden_effects import physics
from tools.hidden_effects.drawn_trials import drawn_trial
from tools.hidden_effects.menu import MENU, with_effects
from tools.hidden_effects.motions import MOTIONS, STILL, Motion, drawn
from tools.hidden_effects.off_menu import FIRST_TWELVE, IDEAS, OFF_MENU
from tools.hidden_effects.recordings import PRESSURE_NOISE, SPOOL_NOISE, at_rest, record
from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.hidden_effects.score import _plain
from tools.hidden_effects.sizes import SIZES

pytestmark = pytest.mark.long

Array = NDArray[np.float64]
TIME = np.arange(1500) * physics.TICK
COMMAND = 4.0 * np.sin(2.0 * np.pi * 2.0 * TIME) + 1.0 * np.sin(2.0 * np.pi * 11.0 * TIME)


def hidden(name: str, **parameters: float) -> RigValues:
    return with_effects(TABLE, {name: parameters})


def test_every_effect_has_its_sizes() -> None:
    assert set(SIZES) == set(MENU)
    assert len(MENU) == 35
    assert len(FIRST_TWELVE) == 12
    assert set(FIRST_TWELVE) | set(IDEAS) < set(OFF_MENU)
    fields = set(RigValues._fields)
    for variants in OFF_MENU.values():
        for variant in variants:
            assert set(variant.sizes) <= fields
            assert variant.places


def test_an_unknown_effect_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(ValueError, match="'gremlins' is not known: one of spool_null_bias"):
        with_effects(TABLE, {"gremlins": {"value": 1.0}})


@pytest.mark.parametrize("number", range(len(MENU)))
def test_every_effect_on_the_menu_shows_in_a_recording(number: int) -> None:
    assert shows(number, "single")


@pytest.mark.parametrize("number", range(len(OFF_MENU)))
def test_every_effect_off_the_menu_shows_in_a_recording(number: int) -> None:
    assert shows(number, "off_menu")


def shows(number: int, kind: str) -> bool:
    """Whether an effect moves some reading by more than its noise within the first recording."""
    trial = drawn_trial(kind, 3, number, seconds=6.0)
    envelope = trial.envelope
    healthy = TABLE._replace(**envelope.nuisances)
    # A stop is met once in a while: everything is run over the whole of its motion.
    tables = [
        record(rig, trial.motions["identify_1"], np.random.default_rng(1)).table
        for rig in (healthy, envelope.values())
    ]
    noise = (5e-5, PRESSURE_NOISE, PRESSURE_NOISE, SPOOL_NOISE)
    difference = np.abs(tables[1] - tables[0])[:, 2:]
    return bool((difference.max(axis=0) > noise).any())


NEUTRAL: Mapping[str, Mapping[str, float]] = {
    "valve_rate_limit": {"value": 1e9},
    "supply_ripple": {"amplitude": 0.0, "frequency": 50.0, "phase": 1.0},
    "spring_load": {"stiffness": 0.0, "contact": 0.2},
    "end_stop": {},
    "valve_bandwidth": {"value": TABLE.spool_frequency},
    "bulk_modulus": {"value": TABLE.oil_stiffness},
    "supply_pressure": {"value": TABLE.pump_pressure},
    "stiction_level": {"value": TABLE.break_away},
    "coulomb_level": {"value": TABLE.sliding},
    "stribeck_velocity": {"value": TABLE.stribeck},
    "viscous_friction": {"value": TABLE.drag},
    "presliding_compliance": {"value": TABLE.seal_stiffness},
    "pressure_1_gain": {"value": 1.0},
    "pressure_2_gain": {"value": 1.0},
    "position_gain": {"value": 1.0},
}


@pytest.mark.parametrize("name", MENU)
def test_at_its_neutral_value_an_effect_is_absent(name: str) -> None:
    neutral = hidden(name, **NEUTRAL.get(name, {"value": 0.0}))
    assert np.array_equal(ran(neutral, COMMAND[:300])[0], ran(TABLE, COMMAND[:300])[0])


def test_a_null_bias_moves_the_ram_though_the_spool_reads_zero() -> None:
    readings, _ = ran(hidden("spool_null_bias", value=2e-5), np.zeros(1000))
    assert np.all(readings[:, 4] == 0.0)
    assert readings[-1, 1] - readings[0, 1] > 5e-3


def test_an_overlapped_valve_passes_nothing_until_it_is_crossed() -> None:
    rig = hidden("valve_deadband", value=2e-5)
    below = 0.9 * 2e-5 / TABLE.spool_per_volt
    _, still = ran(rig, np.full(500, below))
    assert np.ptp(still[:, physics.POSITION]) == 0.0
    _, moving = ran(rig, np.full(500, 4.0 * below))
    _, healthy = ran(TABLE, np.full(500, 4.0 * below - 2e-5 / TABLE.spool_per_volt))
    speeds = [np.mean(found[300:, physics.SPEED]) for found in (moving, healthy)]
    assert speeds[0] == pytest.approx(speeds[1], rel=5e-3)


def test_an_underlapped_valve_leaks_through_at_null_and_doubles_its_gain_there() -> None:
    rig = hidden("valve_underlap_leakage", value=2e-5)._replace(pump_droop=1e12)
    out = np.empty(len(physics.STATES))
    states = at_rest(rig, 0.3)
    physics.slopes(rig, 0.0, 0.0, states, out)
    assert out[physics.SUPPLY] < 0.0
    assert out[physics.P1] == pytest.approx(0.0, abs=1.0)
    rates = []
    for values in (TABLE, rig):
        states[physics.SPOOL] = 1e-6
        physics.slopes(values, 0.0, 0.0, states, out)
        rates.append(out[physics.P1])
    assert rates[1] == pytest.approx(2.0 * rates[0], rel=1e-6)


def test_port_2_passes_less_by_its_asymmetry() -> None:
    out, flows = np.empty(len(physics.STATES)), []
    states = at_rest(TABLE, 0.3)
    states[physics.SPOOL] = 1e-4
    for values in (TABLE, hidden("valve_flow_asymmetry", value=0.2)):
        physics.slopes(values, 0.0, 0.0, states, out)
        flows.append((out[physics.P1], out[physics.P2]))
    assert flows[1][0] == flows[0][0]
    assert flows[1][1] == pytest.approx(0.8 * flows[0][1])


def test_hysteresis_keeps_the_spool_back_by_its_half_width() -> None:
    _, found = ran(hidden("valve_hysteresis", value=1e-5), np.r_[np.full(500, 5.0), np.zeros(500)])
    assert found[499, physics.SPOOL] == pytest.approx(5.0 * TABLE.spool_per_volt - 1e-5, rel=1e-3)
    assert found[-1, physics.SPOOL] == pytest.approx(1e-5, rel=1e-3)


def test_a_rate_limit_is_the_greatest_speed_of_the_spool() -> None:
    _, found = ran(hidden("valve_rate_limit", value=5e-3), 8.0 * np.sign(COMMAND))
    assert np.abs(found[:, physics.SPOOL_SPEED]).max() == pytest.approx(5e-3)
    assert np.abs(np.diff(found[:, physics.SPOOL])).max() <= 5.0001e-6


@pytest.mark.parametrize("delay", [4e-3, 2.5e-3])
def test_a_delayed_command_moves_everything_later(delay: float) -> None:
    _, late = ran(hidden("command_delay", value=delay), COMMAND)
    _, early = ran(TABLE, COMMAND)
    for state, within in ((physics.SPOOL, 2e-6), (physics.POSITION, 2e-5)):
        expected = np.interp(TIME - delay, TIME, early[:, state])
        assert late[20:, state] == pytest.approx(expected[20:], abs=within)


@pytest.mark.parametrize(("name", "value", "column"), [("position_delay", 5.5e-3, 1)])
def test_a_delayed_encoder_reads_the_past(name: str, value: float, column: int) -> None:
    readings, truth = ran(hidden(name, value=value), COMMAND)
    past = np.interp(TIME - value, TIME, truth[:, physics.POSITION])
    assert np.abs(readings[20:, column] - past[20:]).max() < physics.COUNT


def test_backlash_is_lost_motion_of_its_full_width() -> None:
    readings, truth = ran(hidden("position_backlash", value=1e-3), COMMAND)
    lost = readings[200:, 1] - truth[200:, physics.POSITION]
    assert np.abs(lost).max() == pytest.approx(5e-4, abs=physics.COUNT)
    assert np.ptp(lost) == pytest.approx(1e-3, abs=2 * physics.COUNT)


def test_gauges_and_encoder_read_gain_times_truth_and_their_bias() -> None:
    rig = with_effects(
        TABLE,
        {
            "pressure_1_gain": {"value": 1.1},
            "pressure_1_bias": {"value": 2e5},
            "position_gain": {"value": 0.95},
        },
    )
    readings, truth = ran(rig, COMMAND)
    assert readings[:, 2] == pytest.approx(1.1 * truth[:, physics.P1] + 2e5)
    assert readings[:, 3] == pytest.approx(truth[:, physics.P2])
    assert readings[:, 1] == pytest.approx(0.95 * truth[:, physics.POSITION], abs=physics.COUNT)


def test_lagging_gauges_follow_as_a_first_order_lag_does() -> None:
    readings, truth = ran(hidden("pressure_lag", value=0.02), COMMAND)
    rate = np.gradient(readings[:, 2], physics.TICK)
    implied = readings[:, 2] + 0.02 * rate
    error = (implied - truth[:, physics.P1])[5:-5]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.std(truth[:, physics.P1])


def test_friction_asymmetry_and_constant_force_are_one_while_moving() -> None:
    forces = []
    for rig in (
        TABLE,
        hidden("friction_asymmetry", value=200.0),
        hidden("constant_force", value=200.0),
    ):
        pair = []
        for volts in (5.0, -5.0):
            _, found = ran(rig, np.full(650, volts))
            settled = found[450:]
            drop = settled[:, physics.P1] - settled[:, physics.P2]
            pair.append(TABLE.ram_area * float(np.mean(drop)))
        forces.append(pair)
    for other in forces[1:]:
        assert np.subtract(other, forces[0]) == pytest.approx([200.0, 200.0], abs=3.0)


def test_a_coulomb_shift_takes_stiction_along_and_a_stiction_shift_stands_alone() -> None:
    less = hidden("coulomb_level", value=550.0)
    assert (less.sliding, less.break_away) == (550.0, 1200.0)
    assert hidden("stiction_level", value=3000.0).sliding == TABLE.sliding


def test_noise_is_that_of_the_sensors_and_pressures_are_cut_at_zero() -> None:
    table = record(TABLE, drawn("no_command", np.random.default_rng(2), 4000),
                   np.random.default_rng(3)).table  # fmt: skip
    assert np.std(table[:, 3]) == pytest.approx(PRESSURE_NOISE, rel=0.1)
    assert np.std(table[:, 5]) == pytest.approx(SPOOL_NOISE, rel=0.1)
    counts = table[:, 2] / physics.COUNT
    assert counts == pytest.approx(np.rint(counts), abs=1e-6)
    pressed = drawn("pressed_on_the_stop", np.random.default_rng(2), 3000)
    table = record(TABLE, pressed, np.random.default_rng(3)).table
    assert table[:, 3:5].min() == 0.0


@pytest.mark.parametrize("name", [*MOTIONS, *STILL])
def test_a_motion_is_within_reach_and_its_own(name: str) -> None:
    motions = [drawn(name, np.random.default_rng(seed), 8000) for seed in (1, 1, 2)]
    assert np.array_equal(motions[0].setpoint, motions[1].setpoint)
    assert asked(motions[0]) != asked(motions[2]) or name == "no_command"
    for motion in motions:
        assert motion.setpoint.min() > -0.05
        assert motion.setpoint.max() < 0.65
        assert np.abs(motion.feed).max() <= 10.0


def asked(motion: Motion) -> tuple[float, ...]:
    return (*motion.setpoint[::500], *motion.feed[::500])


def test_right_places_are_told_in_the_words_of_the_answer() -> None:
    plant = servo_actuator(Model())
    known = {"command", *(e.name for e in plant.equations), *(v.name for v in plant.varying)}
    known |= {_plain(f"reading of {output.channel}") for output in plant.outputs}
    places = [place for kinds in OFF_MENU.values() for kind in kinds for place in kind.places]
    assert {equation for place in places for equation in place.equations} <= known
