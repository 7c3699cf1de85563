"""Readers of files: configuration, recordings, and what runs leave in their folders."""

import gzip
import json
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from estimator.accounts import NUISANCES, NuisanceBelief
from estimator.baselines.baseline import PATTERN_FILTERS, Baseline
from estimator.baselines.baseline_file import content_of, load_baseline
from estimator.leaks.pattern import HealthyLevel
from rig.configuration import check
from rig.plant import Model
from rig.recording import Recording, export, read_recording, recover
from rig.recording.formats import write_mcap
from rig.runner.counters import CounterError, read_counters
from rig.runner.run_folder import begun_in, read_run
from rig.runner.run_folder.comparing import compare
from rig.runner.run_folder.directory import files_of_run
from rig.runner.run_folder.journal import JOURNAL, Journal, read_journal
from rig.runner.schedule.additions import ADDITIONS, asked_of

from .target import Target, as_file, scratch

ROOT: Final = Path(__file__).parents[2]
_ROWS: Final = 1001
"""A second of samples, the shortest recording that is read."""


def _configuration(kind: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / "config" / kind).glob("*"))]


_CAMPAIGN: Final = b"""\
name: a
rig: simulated
model: nominal
detector: {filter: product, false_alarms_per_day: 1}
tests:
  - name: one
    duration: 5 s
    settle: 0.5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz, phase: 0.1 rad}
    faults: [{type: internal_leakage, at: 1 s, flow: 0.5 L/min, pressure: 2.5 MPa}]
    limits: [{channel: pressure_1_Pa, high: 10 MPa, action: hold, for: 5 ms}]
"""
_MATRIX: Final = b"""\
name: b
rig: ideal
model: nominal
defaults: {duration: 5 s, setpoint: {type: steps, levels: [0.2 m, 0.4 m], hold: 2 s}}
tests:
  - name: ${leak}
    repeats: 2
    matrix: {leak: [external_leakage_1, external_leakage_2]}
    faults: [{type: "${leak}", at: 1 s, flow: 0.5 L/min, pressure: 6.9 MPa}]
"""
"""Small campaigns: the dry run of a shipped one takes a third of a second."""


def _checked(path: Path) -> object:
    return str(check(path))


@cache
def _recordings() -> dict[str, bytes]:
    """Return a small recording in each format, by the name's end."""
    folder = scratch() / "seeds"
    folder.mkdir(exist_ok=True)
    time_s = np.arange(_ROWS) * 1e-3
    channels = {
        "time_s": time_s,
        "command_V": np.full(_ROWS, 1.0),
        "position_m": np.full(_ROWS, 0.5),
        "pressure_1_Pa": np.full(_ROWS, 4e6),
        "pressure_2_Pa": np.full(_ROWS, 5e6),
    }
    whole = folder / "whole.mcap"
    whole.unlink(missing_ok=True)
    write_mcap(whole, channels, {"rig": "simulated"}, [])
    recording: Recording = read_recording(whole)
    found = {"mcap": whole.read_bytes()}
    for end in ("csv", "parquet"):
        path = folder / f"whole.{end}"
        path.unlink(missing_ok=True)
        export(recording, path)
        found[end] = path.read_bytes()
    found["csv.gz"] = gzip.compress(found["csv"], mtime=0)
    return found


def _recovered(path: Path) -> object:
    out = path.with_name("recovered.mcap")
    out.unlink(missing_ok=True)
    return recover(path, out)


def _recording(name: str, end: str) -> Target:
    read = as_file(f"given.{end}", lambda path: read_recording(path))
    return Target(name, read, lambda: [_recordings()[end]])


def _run(path: Path) -> object:
    run = read_run(path.parent)
    files_of_run(path.parent)
    return compare(run, run)


@cache
def _journal() -> bytes:
    folder = scratch() / "journal"
    folder.mkdir(exist_ok=True)
    with Journal(folder) as journal:
        journal.write("begin", campaign="c", tests=["one"], started="2026-01-01T00:00:00+00:00")
        journal.write("phase", test=0, attempt=1, phase="main")
        journal.write("end", reason="", exit_code=0)
    return (folder / JOURNAL).read_bytes()


def _read_journal(path: Path) -> object:
    read_journal(path)
    files_of_run(path.parent)
    return begun_in(path.parent)


def _counters(path: Path) -> object:
    try:
        return read_counters("bench", path)
    except CounterError:
        return None


_COUNTERS: Final = json.dumps(
    {
        "since": "2026-01-01T00:00:00+00:00",
        "total": {"cycles": 1.0, "metres": 2.0, "hours": 3.0},
        "maintained": "",
        "maintenance": "",
        "at_maintenance": {"cycles": 0.0, "metres": 0.0, "hours": 0.0},
    }
).encode()


def _in_folder(name: str) -> str:
    """Return a name in a folder of its own, as files of a run stand in one."""
    (scratch() / name).parent.mkdir(exist_ok=True)
    return name


def _baseline() -> bytes:
    count = len(NUISANCES)
    level = HealthyLevel(np.full(2, 1e4), np.full(2, 1e3), 100)
    baseline = Baseline(
        NuisanceBelief(np.zeros(count), np.eye(count)),
        dict.fromkeys(PATTERN_FILTERS, level),
        {"one.mcap": "0" * 64},
        "nominal",
    )
    return json.dumps(content_of(baseline)).encode()


FILES: Final = (
    Target("campaign", as_file("given.yaml", _checked), lambda: [_CAMPAIGN, _MATRIX]),
    *(
        Target(
            kind,
            as_file(f"given.{end}", _checked),
            lambda kind=folder: _configuration(kind),  # type: ignore[misc]
        )
        for kind, folder, end in (
            ("rig", "rigs", "yaml"),
            ("model", "models", "yaml"),
            ("map", "maps", "yaml"),
            ("stream_profile", "stream", "yaml"),
            ("schedule", "schedules", "yaml"),
            ("sweep", "sweeps", "yaml"),
            ("transducer", "transducers", "yaml"),
            ("dbc", "dbc", "dbc"),
        )
    ),
    _recording("mcap", "mcap"),
    _recording("csv", "csv"),
    _recording("csv_gz", "csv.gz"),
    _recording("parquet", "parquet"),
    Target(
        "recover", as_file("cut.mcap", _recovered), lambda: [_recordings()["mcap"]]
    ),
    Target(
        "results",
        lambda data: as_file(_in_folder("run/results.json"), _run)(data),
        lambda: [(ROOT / ".ci/reference/quickstart/results.json").read_bytes()],
        65536,
    ),
    Target(
        "journal",
        lambda data: as_file(_in_folder(f"begun/{JOURNAL}"), _read_journal)(data),
        lambda: [_journal()],
    ),
    Target(
        "additions",
        lambda data: as_file(
            _in_folder(f"schedule/{ADDITIONS}"), lambda path: list(asked_of(path.parent))
        )(data),
        lambda: [b'{"id": "a", "campaign": "quickstart"}\n{"id": "b", "resume": true}\n'],
    ),
    Target(
        "baseline",
        as_file("baseline.json", lambda path: load_baseline(path, Model())),
        lambda: [_baseline()],
    ),
    Target("counters", as_file("counters.json", _counters), lambda: [_COUNTERS]),
)  # fmt: skip
"""Targets that read files."""
