"""`rig calibrate valves` on a rig that only reckons: what it writes, and when it writes nothing."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rig.cli.hardware.calibrate
from faults.bypass import NOMINAL_BYPASSES
from rig.configuration import load_rig
from rig.io.driver import DriverError
from rig.io.signals import METERS
from rig.loop.interlocks.trip import TripError
from rig.supervisor.calibration import WAYS, Samples
from tests.rig.cli.conftest import Invoke

ARGUMENTS = ("calibrate", "valves", "--rig", "emulated", "--points", 3)
DROP_PA = 4e6
TICKS = 6000


class ReckonedStrokes:
    """Strokes in which every bypass passes what the nominal one does, with a little noise."""

    passed = staticmethod(lambda kind, opening: NOMINAL_BYPASSES[kind].effective(opening))
    trip_after = 1000

    def __init__(self, _: object) -> None:
        self._open: dict[str, float] = {}
        self._strokes = 0
        self._rng = np.random.default_rng(0)

    def shut_bypasses(self) -> None:
        self._open = {}

    def open_bypass(self, kind: str, opening: float) -> None:
        self._open[kind] = opening

    def feedback(self, kind: str) -> float:
        return self._open[kind]

    def rest(self, duration_s: float) -> Samples:
        return self.stroke(0.0)

    def stroke(self, direction: float) -> Samples:
        self._strokes += 1
        if self._strokes > self.trip_after:
            raise TripError("tripped: the emergency stop is open")
        flows = 5e-7 + 1e-8 * self._rng.standard_normal((TICKS, len(METERS)))
        for index, kind in enumerate(WAYS):
            if kind in self._open:
                flows[:, index] += self.passed(kind, self._open[kind]) * np.sqrt(DROP_PA)
        pressure = DROP_PA if direction >= 0.0 else 0.0
        return Samples(flows, np.tile([pressure, DROP_PA - pressure], (TICKS, 1)))


class NoSession:
    """A session with nothing."""

    def __init__(self, *_: object) -> None:
        pass

    def __enter__(self) -> "NoSession":
        return self

    def __exit__(self, *_: object) -> None:
        pass


@pytest.fixture(autouse=True)
def strokes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Put a rig that reckons in the place of a real one; return how to change it."""
    monkeypatch.setattr(rig.cli.hardware.calibrate, "Session", NoSession)
    monkeypatch.setattr(rig.cli.hardware.calibrate, "Strokes", ReckonedStrokes)

    def change(**attributes: Any) -> None:
        changed = type("Changed", (ReckonedStrokes,), attributes)
        monkeypatch.setattr(rig.cli.hardware.calibrate, "Strokes", changed)

    return change


def test_it_writes_a_file_that_a_rig_file_can_take_its_needles_from(
    invoke: Invoke, tmp_path: Path
) -> None:
    done = invoke(*ARGUMENTS)
    assert (done.code, done.err) == (0, "")
    (file,) = (tmp_path / "calibrations").glob("emulated-*.yaml")
    (tmp_path / "mine.yaml").write_text(
        "name: mine\nparent: emulated\nbypass_valves:\n"
        + "".join(
            f"  {kind}: {{needle: {{calibration: calibrations/{file.name}}}}}\n" for kind in WAYS
        )
    )
    for kind, valve in load_rig(tmp_path / "mine.yaml").bypass_valves.items():
        assert valve.needle.openings == (0.0, 0.5, 1.0)
        assert valve.needle.maximum == pytest.approx(
            NOMINAL_BYPASSES[kind].needle.maximum, rel=0.01
        )


def test_it_shows_each_measurement_and_the_table(invoke: Invoke) -> None:
    reported = invoke(*ARGUMENTS, "--valve", "internal_leakage").out
    assert "internal_leakage 0.5 down: 0.38" in reported
    assert "L/min at 4.00 MPa" in reported
    assert "at most" in reported
    assert "| internal_leakage |       1 |" in reported


def test_what_was_measured_is_kept_as_csv(invoke: Invoke, tmp_path: Path) -> None:
    invoke(*ARGUMENTS, "--out", "day.yaml", "--valve", "external_leakage_2")
    with (tmp_path / "day.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["direction"] for row in rows] == ["up"] * 3 + ["down"] * 3
    assert float(rows[2]["coefficient"]) == pytest.approx(2.6e-8, rel=0.01)
    assert {row["bypass"] for row in rows} == {"external_leakage_2"}


def test_a_trip_ends_it_without_a_table_and_keeps_what_was_measured(
    invoke: Invoke, tmp_path: Path, strokes: Callable[..., None]
) -> None:
    strokes(trip_after=4)
    done = invoke(*ARGUMENTS, "--out", "day.yaml")
    assert done.code == 3
    assert "the emergency stop is open" in done.err
    assert not (tmp_path / "day.yaml").exists()
    assert len((tmp_path / "day.csv").read_text().splitlines()) == 4


def test_a_needle_that_does_not_open_is_refused_with_the_reason(
    invoke: Invoke, tmp_path: Path, strokes: Callable[..., None]
) -> None:
    strokes(passed=staticmethod(lambda kind, opening: 1e-9))
    done = invoke(*ARGUMENTS, "--out", "day.yaml")
    assert done.code == 2
    assert "measure it again" in done.err
    assert "what was measured: day.csv" in done.err
    assert not (tmp_path / "day.yaml").exists()


def test_a_device_that_is_not_there_is_reported_with_the_remedy(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: object) -> None:
        raise DriverError("daq", state="nobody answers", action="switch it on")

    monkeypatch.setattr(NoSession, "__enter__", refuse)
    done = invoke(*ARGUMENTS)
    assert done.code == 2
    assert "switch it on" in done.err


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("--rig", "simulated"), "give a rig with `backend: hardware`"),
        (("--rig", "emulated", "--valve", "supply_leakage"), "passes no flow meter"),
        (("--rig", "emulated", "--valve", "leak"), "'leak' is not one of"),
        (("--rig", "emulated", "--points", "1"), "1 is not in the range"),
        (("--rig", "emulated", "--out", "old.yaml"), "old.yaml exists; name a new file"),
        (("--rig", "emulated", "--out", "old.x"), "old.csv exists; name a new file"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_moves(
    invoke: Invoke,
    tmp_path: Path,
    strokes: Callable[..., None],
    arguments: tuple[str, ...],
    reported: str,
) -> None:
    strokes(trip_after=0)
    for name in ("old.yaml", "old.csv"):
        (tmp_path / name).touch()
    done = invoke("calibrate", "valves", *arguments)
    assert done.code == 2
    assert reported in done.err
    assert not (tmp_path / "calibrations").exists()
