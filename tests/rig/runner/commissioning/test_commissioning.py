"""The steps ask before each motion, and tell what they found against the rig file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.configuration import load_rig
from rig.io.wiring import Wiring
from rig.loop.homing import HomingError
from rig.loop.interlocks.trip import TripError
from rig.plant import Model
from rig.runner import StopFlag
from rig.runner.commissioning.commissioning import Commissioning
from rig.runner.commissioning.operator import DeclinedError, Yes
from rig.runner.commissioning.standing import Noise, Standing

RIG = load_rig("emulated")


class Counting(Yes):
    """Agrees so many times, and then no more."""

    def __init__(self, times: int = 99) -> None:
        self.asked: list[str] = []
        self._times = times

    def agrees(self, motion: str, alive: Any) -> bool:
        """Return whether it still agrees."""
        self.asked.append(motion)
        return len(self.asked) <= self._times


def commissioning(
    monkeypatch: pytest.MonkeyPatch, operator: Counting, *sessions: float | Exception
) -> Commissioning:
    """Return a commissioning whose sessions find these offsets of the encoder, or fail."""
    work = Commissioning(RIG, Model(), Path(), operator, say=lambda text: None, stop=StopFlag())
    left = list(sessions)

    @contextmanager
    def session(rig: Any) -> Iterator[Any]:
        found = left.pop(0)
        if isinstance(found, Exception):
            raise found
        yield SimpleNamespace(offset_m=found)

    monkeypatch.setattr(work, "_session", session)
    return work


def not_homed() -> TripError:
    error = TripError("homing failed: the ram stands")
    error.__cause__ = HomingError("the ram stands")
    return error


@pytest.mark.parametrize(
    ("other_m", "standing", "stroke_max", "limit"),
    [
        (0.3, "as in the file", None, None),
        (0.4, "changed", 0.5069, 0.5),
        (0.29, "changed", 0.6169, None),
    ],
)
def test_the_stroke_is_the_way_between_both_stops_and_its_limit_keeps_its_distance(
    monkeypatch: pytest.MonkeyPatch, other_m: float, standing: str, stroke_max: float | None,
    limit: float | None,
) -> None:  # fmt: skip
    work = commissioning(monkeypatch, Counting(), other_m)
    work._find_stroke(0.3)
    assert work.findings[0].standing == standing
    assert work.changes.stroke_max == stroke_max
    assert work.changes.position_max == limit
    assert work.model.parameters.stroke_max == pytest.approx(stroke_max or 0.6069)


def test_homing_that_fails_is_repeated_once_after_another_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    operator = Counting()
    work = commissioning(monkeypatch, operator, not_homed(), 0.3)
    work._find_stroke(0.3)
    assert work.complete
    assert len(operator.asked) == 2
    work = commissioning(monkeypatch, Counting(), not_homed(), not_homed())
    work._find_stroke(0.3)
    assert work.findings[0].standing == "not found"
    assert "the ram stands" in work.findings[0].remark


def test_a_trip_or_a_no_ends_it_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TripError, match="emergency stop"):
        commissioning(monkeypatch, Counting(), TripError("emergency stop"))._find_stroke(0.3)
    with pytest.raises(DeclinedError):
        commissioning(monkeypatch, Counting(0), 0.3)._find_stroke(0.3)


def test_sensors_that_share_a_key_get_the_noise_of_the_noisiest_and_only_if_it_differs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    work = commissioning(monkeypatch, Counting())
    noise = {
        "pressure_1_Pa": Noise(31e3, 0.01), "pressure_2_Pa": Noise(62e3, 0.01),
        "spool_m": Noise(1.1e-6, 0.01),
    }  # fmt: skip
    work._tell_noise(Standing(0.0, noise, ("supply_pressure_Pa",)))
    assert work.changes.noises == {"pressure_noise": 62e3}
    assert work.rig.sensors.pressure_noise == 62e3
    (silent,) = (each for each in work.findings if each.standing == "not found")
    assert silent.subject == "noise of supply_pressure_Pa"
    assert work.rig.wiring == Wiring()
