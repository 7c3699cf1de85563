from typing import Any

import pytest

from rig.configuration.campaigns.campaign import plain
from rig.plant import Model, Parameters
from rig.report.wording import conditions_of
from rig.runner.outcomes.recorded import assumed_parameters


@pytest.mark.parametrize(
    ("setpoint", "text"),
    [
        (
            {"type": "Sine", "mean": 0.3, "amplitude": 0.2, "frequency_hz": 0.5, "phase_rad": 0.1,
             "quantity": "position"},
            "sine: mean 300 mm, amplitude 200 mm, frequency 0.5 Hz, phase 0.1 rad",
        ),
        (
            {"type": "Sine", "mean": 0.0, "amplitude": 3.0, "quantity": "command"},
            "sine: mean 0 V, amplitude 3 V",
        ),
        (
            {"type": "Chirp", "start_hz": 0.1, "sweep_hz_per_s": 0.05},
            "chirp: start 0.1 Hz, sweep 0.05 Hz/s",
        ),
        (
            {"type": "Steps", "levels": [0.1, 0.4], "hold_s": 2.0, "quantity": "position"},
            "steps: levels 100 / 400 mm, hold 2 s",
        ),
        ({"type": "FromFile", "path": "ram.csv"}, "from file: path ram.csv"),
        ({"type": "Steps", "levels": [0.1] * 50}, "steps: levels (50 values)"),
    ],
)  # fmt: skip
def test_a_setpoint_is_reported_with_its_units(setpoint: dict[str, Any], text: str) -> None:
    assert list(conditions_of({"test": {"setpoint": setpoint}})) == [("Setpoint", text)]


def test_a_spring_is_reported_with_its_units() -> None:
    load = {"stiffness": 6e5, "contact": 0.22}
    reported = list(conditions_of({"test": {"load": load}}))
    assert reported == [("Load", "spring of 6e+05 N/m, met at 220 mm")]


@pytest.mark.parametrize("metadata", [{}, {"test": None}, {"test": {"load": {"kind": "?"}}}])
def test_metadata_of_another_program_do_not_matter(metadata: dict[str, Any]) -> None:
    assert all("as recorded" in text for _, text in conditions_of(metadata))


def test_the_model_comes_back_as_the_runner_records_it() -> None:
    model = Model().with_effect("spool_null_bias", value=1.5e-6)
    assert assumed_parameters({"model": plain(model)}) == model.parameters


def test_a_model_from_before_an_effect_was_known_has_that_effect_absent() -> None:
    reported = Parameters()._asdict()
    del reported["supply_droop"]
    assert assumed_parameters({"model": {"parameters": reported}}) == Parameters()


@pytest.mark.parametrize(
    "model",
    [None, "nominal", {}, {"parameters": {}}, {"parameters": {"piston_area": "large"}}],
)
def test_an_unreadable_model_is_none(model: Any) -> None:
    assert assumed_parameters({"model": model}) is None
    assert assumed_parameters({}) is None
