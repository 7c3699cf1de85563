"""Fixtures with recordings, which tests write, damage and read back."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.recording import Event, Recording, RecordingError, RecordingProblem, export, read_recording


@pytest.fixture(scope="session")
def healthy() -> Recording:
    """Return a recording of 2 s of a slow sine with sensor noise and the optional spool channel."""
    rng = np.random.default_rng(1)
    n = 2000
    time_s = np.arange(n) / 1000.0
    position_m = np.round((0.3 + 0.02 * np.sin(np.pi * time_s)) / 3e-5) * 3e-5
    channels = {
        "time_s": time_s,
        "command_V": 0.3 * np.cos(np.pi * time_s),
        "position_m": position_m,
        "pressure_1_Pa": 6.9e6 + 3e4 * rng.standard_normal(n),
        "pressure_2_Pa": 6.9e6 + 3e4 * rng.standard_normal(n),
        "spool_m": 8e-6 * np.cos(np.pi * time_s) + 1e-6 * rng.standard_normal(n),
    }
    events = [Event(0.5, "fault", "external_leakage_1 opens"), Event(1.5, "note", "Überdruck")]
    return Recording(channels, {"seed": 1, "rig": {"name": "demo", "tags": ["a", None]}}, events)


@pytest.fixture(scope="session")
def healthy_csv(healthy: Recording, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the lines of the healthy recording as CSV; line k of the file has index k - 1."""
    path = tmp_path_factory.mktemp("healthy") / "healthy.csv"
    export(healthy, path)
    return path.read_text().splitlines()


@pytest.fixture
def judge(tmp_path: Path) -> Callable[..., list[RecordingProblem]]:
    """Return a function that writes a file, reads it as a recording, and returns its problems.

    The function fails if the file can be read.
    """

    def problems(content: str | bytes, name: str = "run.csv") -> list[RecordingProblem]:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(RecordingError) as refusal:
            read_recording(path)
        assert all(problem.path == str(path) for problem in refusal.value.problems)
        return refusal.value.problems

    return problems
