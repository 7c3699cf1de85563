"""What a ram has done is counted once, and is not lost."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings, strategies as st

from rig.cli.hardware.counters import command
from rig.runner.counters.motion import Counted, MotionCounter
from rig.runner.counters.store import (
    CounterError,
    RigCounter,
    counters_path,
    note_maintenance,
    read_counters,
)

TIME = 1e-3 * np.arange(20_001)
SINE = 0.3 + 0.1 * np.sin(np.pi * TIME)


def counted(position: np.ndarray, batch: int = 500) -> Counted:
    counter = MotionCounter()
    for start in range(0, position.size, batch):
        counter.take(position[start : start + batch])
    return counter.counted


def test_a_sine_has_its_cycles_its_way_and_its_time() -> None:
    found = counted(SINE)
    assert found.cycles == 10.0
    assert found.metres == pytest.approx(4.0, abs=2e-3)
    assert found.hours == pytest.approx(20.001 / 3600.0)


def test_a_ram_at_rest_that_dithers_does_nothing() -> None:
    noise = 3e-5 * np.random.default_rng(1).integers(0, 4, TIME.size)
    found = counted(0.3 + noise)
    assert (found.cycles, found.metres) == (0.0, 0.0)


@given(st.integers(1, 700))
@settings(max_examples=20)
def test_batches_do_not_matter(batch: int) -> None:
    assert counted(SINE[:4000], batch) == counted(SINE[:4000])


def test_samples_without_a_value_count_as_time_alone() -> None:
    position = SINE.copy()
    position[5000:6000] = np.nan
    found = counted(position)
    assert found.hours == counted(SINE).hours
    assert found.cycles == 10.0


def test_counters_go_on_in_the_next_process_whatever_ended_the_last(tmp_path: Path) -> None:
    path = tmp_path / "counters" / "rig.json"
    said: list[str] = []
    first = RigCounter("rig", path, said.append)
    first.begins(anew=False)
    first.take(SINE[:9999])
    # Killed here: nothing is closed.
    second = RigCounter("rig", path, said.append)
    second.begins(anew=False)
    second.take(SINE)
    second.save()
    total = read_counters("rig", path).total
    assert total.cycles == 15.0
    assert total.hours == pytest.approx((9999 + 20_001) / 3.6e6)
    assert second.in_test.cycles == 10.0
    assert not said


def test_a_new_rig_for_each_test_is_no_motion_between_them(tmp_path: Path) -> None:
    counter = RigCounter("rig", None, print)
    for position in (np.full(1000, 0.1), np.full(1000, 0.5)):
        counter.begins(anew=True)
        counter.take(position)
        assert counter.in_test.metres == 0.0


def test_a_file_that_is_none_of_counters_is_told_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    said: list[str] = []
    path.write_text("{")
    with pytest.raises(CounterError, match="move it away"):
        read_counters("rig", path)
    RigCounter("rig", path, said.append)
    assert "kept as rig.json.unreadable" in said[0]
    path.write_text(json.dumps({"since": "", "total": {"cycles": -1, "metres": 0, "hours": 0}}))
    with pytest.raises(CounterError):
        read_counters("rig", path)


def test_a_file_that_cannot_be_written_stops_no_test(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    said: list[str] = []
    counter = RigCounter("rig", tmp_path / "taken" / "rig.json", said.append)
    counter.take(SINE)
    counter.take(SINE)
    assert len([each for each in said if "cannot be written" in each]) == 1


def test_the_command_shows_totals_and_what_came_since_a_maintenance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    counter = RigCounter("emulated", counters_path("emulated"), print)
    counter.take(SINE)
    counter.save()
    shown = CliRunner().invoke(command, ["emulated"], standalone_mode=False).output
    assert "emulated: 10 cycles, 4.0 m, 0.01 h since" in shown
    note_maintenance("emulated", "new\nseals")
    shown = CliRunner().invoke(command, ["emulated"], standalone_mode=False).output
    assert "0 cycles, 0.0 m, 0.00 h since the maintenance of" in shown
    assert "(new seals)" in shown


def test_a_simulated_rig_does_not_wear() -> None:
    result = CliRunner().invoke(command, ["simulated"])
    assert "does not wear" in result.output
