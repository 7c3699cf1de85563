"""Fixtures with the outcomes of three tests, each run once, for tests of the report.

One test is healthy, one has a leak of chamber 1, and one has that leak and a thesis filter.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import start_memory
from estimator.leaks.replaying import replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import LEAKS, Model
from rig.plant.faults import FAULT_COLUMNS
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import McapWriter, Recording, read_recording
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome

Array = NDArray[np.float64]

DURATION_S = 20.0
INJECTED_AT_S = 8.0
LEAK_L_PER_MIN = 0.5
SETPOINT = {
    "type": "Sine",
    "mean": 0.3,
    "amplitude": 0.2,
    "frequency_hz": 0.5,
    "quantity": "position",
}


def run_on_loop(directory: Path, name: str, filter_name: str, leak_l_per_min: float) -> TestOutcome:
    """Run a sine with a leak of chamber 1 from 8 s on, record and judge it; return the outcome.

    The recording is written to `directory`; a leak of 0 makes a healthy test.
    """
    model = Model()
    time_s = np.arange(round(DURATION_S * 1e3)) * 1e-3
    faults = np.zeros((time_s.size, len(FAULT_COLUMNS)))
    coefficient = leak_l_per_min * LITRE_PER_MINUTE / np.sqrt(6.9e6)
    faults[time_s >= INJECTED_AT_S, FAULT_COLUMNS.index("external_leakage_1")] = coefficient
    truth = model.with_effect("spool_null_bias", value=1.5e-6)
    motion = Motion(0.3 + 0.2 * np.sin(np.pi * time_s), False, faults, 0.3, 1000)
    memory = start_memory(filter_name, model)
    loop = SimulatedLoop(simulated_rig(truth, seed=1), motion, memory, model.parameters)
    loop.position()
    metadata: dict[str, Any] = {
        "model": {"name": model.name, "parameters": model.parameters._asdict()},
        "test": {"setpoint": SETPOINT},
    }
    path = directory / f"{name}.mcap"
    with McapWriter(path, loop.channels, metadata) as writer:
        writer.write(loop.advance(loop.ticks_left))
        writer.event(0.0, "test_begin", name)
    recording = read_recording(path)
    result = replay(recording, model, filter_name=filter_name)
    injected = _injected(recording, coefficient) if leak_l_per_min else ()
    expect = injected[0].kind if injected else "healthy"
    return TestOutcome(
        name=name,
        expect=expect,
        status=Status.PASSED if result.decision.verdict == expect else Status.FAILED,
        seed=1,
        duration_s=DURATION_S,
        injected=injected,
        decision=result.decision,
        detected_at_s=result.detected_at_s,
        recording=path.name,
        recorded_s=DURATION_S,
    )


def _injected(recording: Recording, coefficient: float) -> tuple[InjectedFault, ...]:
    flow = recording["true_leak_1_m3_per_s"][recording.time_s >= INJECTED_AT_S + 2.0]
    mean = float(np.abs(flow).mean())
    return (InjectedFault(LEAKS[0], INJECTED_AT_S, None, coefficient, False, mean),)


@pytest.fixture(scope="session")
def run_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the recordings."""
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="session")
def healthy(run_directory: Path) -> TestOutcome:
    """Return the outcome of a healthy test with the product filter."""
    return run_on_loop(run_directory, "healthy", "product", 0.0)


@pytest.fixture(scope="session")
def leaking(run_directory: Path) -> TestOutcome:
    """Return the outcome of a test with a leak of chamber 1 and the product filter."""
    return run_on_loop(run_directory, "leaking", "product", LEAK_L_PER_MIN)


@pytest.fixture(scope="session")
def by_thesis_filter(run_directory: Path) -> TestOutcome:
    """Return the outcome of a test with the same leak and the thesis's 7-state filter."""
    return run_on_loop(run_directory, "by_thesis_filter", "thesis-7", LEAK_L_PER_MIN)


@pytest.fixture(scope="session")
def campaign() -> Callable[..., CampaignOutcome]:
    """Return a function that makes a campaign's outcome from those of its tests.

    Keywords replace other fields of the outcome.
    """

    def of(*tests: TestOutcome, **changed: Any) -> CampaignOutcome:
        reported: dict[str, Any] = {
            "name": "trial",
            "description": "A healthy rig and a leak.",
            "rig": "simulated",
            "model": "nominal",
            "filter": "product",
            "false_alarms_per_day": 1.0,
            "started": "2026-11-21T06:00:00+00:00",
            "tests": tests,
            "provenance": {"versions": {"rig": "0.1.0"}, "source_files": {"trial.yaml": "ab" * 32}},
        }
        return CampaignOutcome(**(reported | changed))

    return of
