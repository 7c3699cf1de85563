"""Other forms of an effect agree with the catalogue's at one point and differ elsewhere."""

import numpy as np
import pytest

from tests.tools.hidden_effects.test_physics import ran
from tools.hidden_effects import physics
from tools.hidden_effects.drawn_trials import Choice, drawn_trial, recordings
from tools.hidden_effects.forms import FORMS
from tools.hidden_effects.menu import MENU, with_effects
from tools.hidden_effects.off_menu import OFF_MENU
from tools.hidden_effects.recordings import PRESSURE_NOISE, SPOOL_NOISE, at_rest, record
from tools.hidden_effects.rig_values import TABLE, RigValues

OTHER = Choice(forms="other")
ALL = Choice(off_menu="all")
NOISE = (5e-5, PRESSURE_NOISE, PRESSURE_NOISE, SPOOL_NOISE)
TIME = np.arange(1500) * physics.TICK
COMMAND = 4.0 * np.sin(2.0 * np.pi * 2.0 * TIME) + 1.0 * np.sin(2.0 * np.pi * 11.0 * TIME)


def rates(rig: RigValues, **states: float) -> dict[str, float]:
    y = at_rest(rig, 0.3)
    for name, value in states.items():
        y[physics.STATES.index(name)] = value
    out = np.empty(len(y))
    physics.slopes(rig, 0.0, 0.0, y, out)
    return dict(zip(physics.STATES, out.tolist(), strict=True))


def hidden(name: str, form: str, **parameters: float) -> RigValues:
    return with_effects(TABLE, {name: parameters}, {name: form})


def test_every_form_belongs_to_an_effect_and_tells_its_source() -> None:
    assert set(FORMS) < set(MENU)
    for forms in FORMS.values():
        for form in forms.values():
            assert form.shape.__doc__ is not None
            assert any(character.isdigit() for character in form.shape.__doc__)


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(FORMS)))
def test_every_other_form_differs_in_a_recording_from_that_of_the_catalogue(number: int) -> None:
    trial = drawn_trial("single", 3, number, seconds=6.0, choice=OTHER)
    envelope = trial.envelope
    motion = trial.motions["identify_1"]
    catalogue = with_effects(TABLE._replace(**envelope.nuisances), envelope.effects)
    tables = [
        record(rig, motion, np.random.default_rng(1)).table
        for rig in (envelope.values(), catalogue)
    ]
    assert np.isfinite(tables[0]).all()
    difference = np.abs(tables[1] - tables[0])[:, 2:]
    assert (difference.max(axis=0) > np.multiply(0.5, NOISE)).any()


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(OFF_MENU)))
def test_every_kind_off_the_menu_shows_in_a_recording(number: int) -> None:
    trial = drawn_trial("off_menu", 3, number, seconds=6.0, choice=ALL)
    found = recordings(trial)
    for name, motion in trial.motions.items():
        healthy = record(
            TABLE._replace(**trial.envelope.nuisances), motion, np.random.default_rng(1)
        ).table
        assert np.isfinite(found[name].table).all()
        if (np.abs(found[name].table - healthy)[:, 2:].max(axis=0) > np.multiply(8, NOISE)).any():
            return
    pytest.fail(str(trial.envelope))


@pytest.mark.parametrize("form", FORMS["internal_leakage"])
def test_leaks_of_all_forms_are_equal_at_two_megapascals(form: str) -> None:
    states = {"pressure_1": 8e6, "pressure_2": 6e6}
    rig = hidden("internal_leakage", form, value=5e-9, transition=1e6)
    catalogue = with_effects(TABLE, {"internal_leakage": {"value": 5e-9}})
    assert rates(rig, **states)["pressure_1"] == pytest.approx(
        rates(catalogue, **states)["pressure_1"]
    )
    states["pressure_1"] = 10e6
    assert rates(rig, **states)["pressure_1"] != pytest.approx(
        rates(catalogue, **states)["pressure_1"], rel=0.05
    )


@pytest.mark.parametrize("form", FORMS["valve_underlap_leakage"])
def test_edges_of_all_forms_are_open_by_the_underlap_at_null(form: str) -> None:
    rig = hidden("valve_underlap_leakage", form, value=1e-5)
    catalogue = with_effects(TABLE, {"valve_underlap_leakage": {"value": 1e-5}})
    states = {"pressure_1": 9e6, "pressure_2": 5e6}
    assert rates(rig, **states)["pressure_1"] == pytest.approx(
        rates(catalogue, **states)["pressure_1"]
    )
    # Beyond its underlap, an edge of the catalogue is shut; these leak there.
    states |= {"spool": 3e-5, "pressure_1": 5e6, "pressure_2": 9e6}
    assert rates(rig, **states)["pressure_2"] != rates(catalogue, **states)["pressure_2"]


def test_droop_of_all_forms_is_equal_at_eighteen_litres_per_minute() -> None:
    for exponent in (1.0, 1.75):
        assert 3e-4**2 * physics._power(1.0, exponent) == pytest.approx(3e-4**2)
        assert physics._power(-0.25, exponent) == pytest.approx(-(0.25**exponent))


@pytest.mark.parametrize(
    ("form", "share"),
    [
        ("exponent 0.5", np.exp(-np.sqrt(2.0))),
        ("exponent 2", np.exp(-4.0)),
        ("Hess-Soom", 0.2),
    ],
)
def test_stribeck_curves_fall_as_their_sources_say(form: str, share: float) -> None:
    rig = hidden("stribeck_velocity", form, value=0.05)
    level = physics.slip_force(rig, 0.3, 0.1, 6.9e6, 6.9e6)
    assert level == pytest.approx(TABLE.sliding + (TABLE.break_away - TABLE.sliding) * share)


def test_a_smooth_hysteresis_keeps_the_spool_back_by_its_half_width() -> None:
    rig = hidden("valve_hysteresis", "Bouc-Wen", value=1e-5, reach=1.0)
    _, found = ran(rig, np.r_[np.full(300, 5.0), np.full(300, -5.0), np.zeros(300)])
    assert found[299, physics.SPOOL] == pytest.approx(5.0 * TABLE.spool_per_volt - 1e-5, rel=1e-3)
    assert found[-1, physics.SPOOL] == pytest.approx(-1e-5, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "form"),
    [("command_delay", "slower hold"), ("valve_bandwidth", "first order and delay")],
)
def test_a_spool_of_another_form_is_as_late_in_slow_motions(name: str, form: str) -> None:
    value = {"command_delay": 5e-3, "valve_bandwidth": 300.0}[name]
    ramp = np.asarray(4.0 * TIME[:400], dtype=np.float64)
    _, other = ran(hidden(name, form, value=value), ramp)
    _, same = ran(with_effects(TABLE, {name: {"value": value}}), ramp)
    lost = np.mean((other - same)[200:, physics.SPOOL])
    assert lost == pytest.approx(0.0, abs=5e-4 * 4.0 * TABLE.spool_per_volt)


def test_seals_of_all_forms_slide_with_the_same_friction() -> None:
    sizes = {"exponent": 1.3, "share": 0.7, "damping_speed": 0.02}
    levels = []
    for form in FORMS["presliding_compliance"]:
        rig = hidden("presliding_compliance", form, value=5e6, **sizes)
        _, found = ran(rig, np.full(700, 4.0))
        levels.append(found[-1, physics.P1] - found[-1, physics.P2])
    assert levels == pytest.approx([levels[0]] * len(levels), rel=1e-3)


def test_a_second_mass_rings_at_its_own_frequency() -> None:
    rig = TABLE._replace(hung_mass=50.0, hung_frequency=60.0, hung_damping=0.02)
    y = at_rest(rig, 0.3)
    y[physics.HUNG] = 2e-4  # too little to move the ram on its seals
    _, found = ran(rig, np.zeros(1000), y)
    spectrum = np.abs(np.fft.rfft(found[:, physics.HUNG], 2**15))
    hertz = np.fft.rfftfreq(2**15, physics.TICK)[int(np.argmax(spectrum))]
    assert hertz == pytest.approx(60.0 / (2.0 * np.pi), rel=0.1)


def test_silt_holds_a_spool_that_has_rested_until_it_is_asked_to_go_far() -> None:
    rig = TABLE._replace(silt=2e-5)
    little, much = 1.5e-5 / TABLE.spool_per_volt, 3e-5 / TABLE.spool_per_volt
    command = np.r_[np.zeros(100), np.full(100, little), np.full(100, much)]
    _, found = ran(rig, command)
    assert found[199, physics.SPOOL] == 0.0
    assert found[-1, physics.SPOOL] == pytest.approx(3e-5, rel=1e-3)


def test_an_amplifier_clips_what_the_recorded_command_asks() -> None:
    readings, found = ran(TABLE._replace(amplifier_volts=1.5), np.full(200, 4.0))
    assert readings[-1, 0] == 4.0
    assert found[-1, physics.SPOOL] == pytest.approx(1.5 * TABLE.spool_per_volt, rel=1e-3)


def test_wires_mix_up_and_hold_readings() -> None:
    trial = drawn_trial("none", 1, 0, seconds=2.0)
    tables = [
        record(rig, trial.motions["identify_1"], np.random.default_rng(1)).table
        for rig in (
            TABLE,
            TABLE._replace(swapped_gauges=1.0),
            TABLE._replace(stuck_reading=3.0, loose_at=1.0),
        )
    ]
    assert np.array_equal(tables[1][:, 3], tables[0][:, 4])
    assert np.array_equal(tables[2][:1000], tables[0][:1000])
    assert np.ptp(tables[2][1000:, 4]) == 0.0
    assert np.array_equal(tables[2][:, 3], tables[0][:, 3])


def test_a_tone_has_another_phase_and_a_jump_another_moment_in_each_recording() -> None:
    drawn = [drawn_trial("off_menu", 3, n, seconds=0.5, choice=ALL) for n in range(len(OFF_MENU))]
    by_name = {next(iter(trial.envelope.off_menu)): trial.envelope for trial in drawn}
    assert set(by_name) == set(OFF_MENU)
    for name, key in (("tone", "tone_phase"), ("stuck_channel", "loose_at")):
        envelope = by_name[name]
        values = {getattr(envelope.values(each), key) for each in envelope.motions}
        assert len(values) == 3
    assert all(0.15 <= v <= 0.35 for v in values)
    assert not by_name["cogging"].by_recording
