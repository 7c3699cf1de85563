"""The study of the friction experiment draws what it says, and counts what intervals hold."""

from types import SimpleNamespace
from typing import Any

from estimator.friction.curve import FrictionEstimate
from estimator.friction.fit import PARAMETERS
from rig.plant import NOMINAL
from tools.studies.friction_experiment import SPREAD, Case, rows, unknown_friction


def test_the_rigs_differ_from_the_model_by_no_more_than_said_and_have_no_spring() -> None:
    drawn = [unknown_friction(seed) for seed in range(40)]
    for name in ("stiction", "coulomb", "stribeck_velocity", "viscous"):
        shares = [getattr(truth, name) / getattr(NOMINAL, name) for truth in drawn]
        assert 1.0 - SPREAD <= min(shares) < 0.8
        assert 1.2 < max(shares) <= 1.0 + SPREAD
    assert all(truth.spring_stiffness == 0.0 for truth in drawn)
    assert all(truth.stiction > truth.coulomb for truth in drawn)


def test_an_interval_that_misses_the_truth_lowers_the_coverage() -> None:
    def case(error: float) -> Case:
        found: Any = SimpleNamespace(
            fit=SimpleNamespace(
                estimates={
                    name: FrictionEstimate(getattr(NOMINAL, name) + error, 1.0, "")
                    for name in PARAMETERS
                },
                measured_stiction=NOMINAL.stiction,
                measured_error=1.0,
            )
        )
        return Case(NOMINAL, found)

    table = rows([case(0.5), case(1.0), case(3.0), case(-2.5)])
    assert [row[2] for row in table] == ["50 %"] * len(PARAMETERS) + ["100 %"]
    assert table[0][1] == "4 of 4"
