"""What is discovered beside what a fit changes: a curve, a corner at its place, or a play."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.search.discovery import Discovering
from estimator.gap.search.refits import Refits
from estimator.gap.search.twins import Twins
from tests.estimator.gap.wheel import ran, wheel


def test_a_drag_keeps_its_value_beside_a_curve_that_a_drag_is_part_of() -> None:
    plant = wheel()
    records = [record_of(ran(seed, 5.0, dry=3.0), plant) for seed in (1, 2)]
    with ThreadPoolExecutor(1) as pool:
        refits = Refits(Fitter(Predictor(plant), records, pool))
        refitted = refits.settled(plant.nominal, refits.nuisances)[0]
        discovering = Discovering(refits, Twins(refits.fitter, 1))
        found = discovering.run(refitted, refits.nuisances, 1.0, most=1)
    assert found.fitted.cost < 0.02 * refitted.cost
    (curve,) = found.additions
    assert (curve.of, curve.form) == ("speed", "table")
    held = {v.parameter: bool(v.is_held) for v in found.variables if v.name != "added"}
    assert held == {"gain": False, "drag": True}
    assert found.fitted.values["drag"] == refitted.values["drag"]
    # What no curve of the speed may stand in for comes to its true value.
    assert refitted.values["gain"] == pytest.approx(3.6, rel=1e-3)
    assert found.fitted.values["gain"] == pytest.approx(4.0, rel=0.01)


def test_a_brake_that_acts_beyond_a_speed_is_found_with_that_speed_and_nothing_else_looked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked = []
    add = Discovering._add

    def counted(self: Discovering, *args: Any) -> bool:
        looked.append(add(self, *args))
        return looked[-1]

    monkeypatch.setattr(Discovering, "_add", counted)
    plant = wheel()
    records = [record_of(ran(seed, 5.0, brake=(1.0, 6.0)), plant) for seed in (1, 2)]
    with ThreadPoolExecutor(1) as pool:
        refits = Refits(Fitter(Predictor(plant), records, pool))
        refitted = refits.settled(plant.nominal, refits.nuisances)[0]
        discovering = Discovering(refits, Twins(refits.fitter, 1))
        found = discovering.run(refitted, refits.nuisances, 1.0)
    (brake,) = found.additions
    assert (brake.place, brake.of, brake.form) == ("force", "speed", "beyond")
    assert brake.at[0] == pytest.approx(1.0, rel=0.02)
    assert abs(brake.values[0]) == pytest.approx(6.0, rel=0.05)
    # What is left is less than another disturbance would have to take away.
    assert looked == [True]


def test_a_sensor_that_sticks_is_a_play_of_its_reading_with_the_width_that_it_has() -> None:
    plant = wheel()
    records = [record_of(ran(seed, 5.0, play=0.05), plant) for seed in (1, 2)]
    with ThreadPoolExecutor(1) as pool:
        refits = Refits(Fitter(Predictor(plant), records, pool))
        refitted = refits.settled(plant.nominal, refits.nuisances)[0]
        discovering = Discovering(refits, Twins(refits.fitter, 1))
        found = discovering.run(refitted, refits.nuisances, 1.0, most=1)
    (sticks,) = found.additions
    assert (sticks.place, sticks.of, sticks.form) == ("reading of speed_m_per_s", "speed", "play")
    assert sticks.at[0] == pytest.approx(0.05, rel=0.05)
    assert sticks.values[0] == pytest.approx(1.0, rel=0.05)
    # It has an error, and not by chance the one of another fit.
    (discovery,) = found.discoveries
    assert 0.0 < discovery.errors[0] < 0.02
