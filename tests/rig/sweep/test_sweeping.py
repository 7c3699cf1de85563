"""A sweep's table is the same wherever, by however many, and with whatever interruptions."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from rig.cli.models.sweep import command
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from rig.runner.run_folder.directory import DirectoryError
from rig.sweep import running
from rig.sweep.cluster import ClusterError, _wanted, connected, run_cluster
from rig.sweep.drawing import Cases, draw
from rig.sweep.folder import SweepFolder
from rig.sweep.group import Setting, SweepError
from rig.sweep.local import Chunks, run_here, run_pool
from rig.sweep.run_cases import Judged, sources
from rig.sweep.running import Runner, Timing, chunk_size, run_sweep
from rig.sweep.table import rows_of, unit_of
from tests.waiting import COMPILE_S, until

TEXT = """\
name: small
rig: ideal
cases: 36
duration: 20 s
seed: 3
parameters:
  bulk_modulus: {uniform: [-15 %, +15 %]}
leaks:
  flow: {log_uniform: [0.1 L/min, 3 L/min]}
  onset: 15.5 s
motions:
  - {type: sine, mean: 0.3 m, amplitude: {uniform: [0.05 m, 0.2 m]}, frequency: 0.5 Hz}
  - {type: pseudorandom, lower: 0.1 m, upper: 0.5 m, hold_min: 1 s, hold_max: 2 s}
"""
Ran = Callable[[Sweep, Path, Runner], bytes]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    file = tmp_path_factory.mktemp("sweep") / "small.yaml"
    file.write_text(TEXT)
    return load_sweep(file)


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "_CHUNK_RIG_S", 100.0)


def run(sweep: Sweep, folder: Path, runner: Runner, *, resume: bool = False) -> Timing:
    with SweepFolder(folder, sweep, resume=resume) as opened:
        timing = run_sweep(sweep, opened, runner, lambda: False, lambda _: None)
        opened.finish()
    return timing


@pytest.fixture(scope="module")
def table(sweep: Sweep, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the table of the sweep, run in this process."""
    folder = tmp_path_factory.mktemp("here")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "_CHUNK_RIG_S", 100.0)
        run(sweep, folder / "run", run_here)
    return (folder / "run" / "sweep.parquet").read_bytes()


def test_the_table_has_a_row_a_case_in_order_with_units(table: bytes, tmp_path: Path) -> None:
    file = tmp_path / "sweep.parquet"
    file.write_bytes(table)
    rows = pq.read_table(file)
    assert rows.column("case").to_pylist() == list(range(36))
    assert unit_of(rows, "bulk_modulus") == "Pa"
    assert unit_of(rows, "leak_true_m3_per_s") == "m^3/s"
    assert set(rows.column("fault").to_pylist()) > {"healthy", "internal_leakage"}
    leaks = [f is not None for f in rows.column("leak_true_m3_per_s").to_pylist()]
    assert leaks == [fault != "healthy" for fault in rows.column("fault").to_pylist()]


def test_chunks_are_whole_groups_of_lanes(sweep: Sweep) -> None:
    assert chunk_size(sweep) == 8


class Interruption(Exception):  # noqa: N818
    pass


def test_an_interrupted_sweep_goes_on_and_repeats_nothing(
    sweep: Sweep, table: bytes, tmp_path: Path
) -> None:
    ran: list[int] = []

    def until_the_third(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        for judged in run_here(chunks, setting, lambda: False):
            if len(ran) == 2:
                raise Interruption
            ran.append(judged.chunk)
            yield judged

    def the_rest(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        for judged in run_here(chunks, setting, lambda: False):
            ran.append(judged.chunk)
            yield judged

    folder = tmp_path / "run"
    with pytest.raises(Interruption):
        run(sweep, folder, until_the_third)
    (folder / "parts" / "part-00000001.arrow").write_bytes(b"cut off")
    ran.remove(1)  # a damaged part is none
    (folder / "parts" / ".part-00000002.arrow.99.part").write_bytes(b"cut off")
    (folder / ".sweep.parquet.99.part").write_bytes(b"cut off")
    run(sweep, folder, the_rest, resume=True)
    assert sorted(ran) == [0, 1, 2, 3, 4]
    left = {"sweep.json", "sweep.parquet", ".lock"}
    assert {file.name for file in folder.iterdir()} == left
    assert (folder / "sweep.parquet").read_bytes() == table


def test_what_the_file_means_must_be_the_same_to_go_on(sweep: Sweep, tmp_path: Path) -> None:
    SweepFolder(tmp_path / "run", sweep, resume=False).close()
    other = tmp_path / "other.yaml"
    other.write_text("# a comment changes nothing\n" + TEXT)
    SweepFolder(tmp_path / "run", load_sweep(other), resume=True).close()
    other.write_text(TEXT.replace("seed: 3", "seed: 4"))
    with pytest.raises(DirectoryError, match="seed changed"):
        SweepFolder(tmp_path / "run", load_sweep(other), resume=True)


def test_a_folder_is_not_shared_and_nothing_foreign_is_replaced(
    sweep: Sweep, tmp_path: Path
) -> None:
    with (
        SweepFolder(tmp_path / "run", sweep, resume=False),
        pytest.raises(DirectoryError, match="a sweep is running in it"),
    ):
        SweepFolder(tmp_path / "run", sweep, resume=True)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(DirectoryError, match="holds letter"):
        SweepFolder(tmp_path / "mine", sweep, resume=False)
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"


def test_the_order_in_which_chunks_are_ready_does_not_matter(
    sweep: Sweep, table: bytes, tmp_path: Path
) -> None:
    def backwards(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        yield from reversed(list(run_here(chunks, setting, lambda: False)))

    run(sweep, tmp_path / "run", backwards)
    assert (tmp_path / "run" / "sweep.parquet").read_bytes() == table


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_processes_make_the_same_table_though_one_is_killed(
    sweep: Sweep, table: bytes, tmp_path: Path, jobs: int
) -> None:
    killed: list[int] = []

    def with_a_death(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        for judged in run_pool(chunks, setting, jobs, lambda: False):
            if not killed:
                killed.append(int(judged.worker.rpartition(":")[2]))
                os.kill(killed[0], signal.SIGKILL)
            yield judged

    timing = run(sweep, tmp_path / "run", with_a_death)
    assert killed
    assert len(timing.ready_s) > 1
    assert (tmp_path / "run" / "sweep.parquet").read_bytes() == table


def deadly(setting: Setting, cases: Cases) -> Judged:
    os._exit(9)


@pytest.mark.long
def test_a_chunk_that_kills_every_process_is_given_up_by_name(
    sweep: Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.sweep.local.run_chunk", deadly)
    monkeypatch.setattr("rig.sweep.local._MOST_DEATHS", 1)
    with pytest.raises(SweepError, match=r"cases [\d, ]+: 2 processes died"):
        run(
            sweep,
            tmp_path / "run",
            lambda chunks, setting, _: run_pool(chunks, setting, 1, lambda: False),
        )


def command_line(*arguments: str, folder: Path) -> list[str]:
    (folder / "small.yaml").write_text(TEXT.replace("cases: 36", "cases: 200"))
    return [sys.executable, "-m", "rig.cli", "sweep", *arguments]


@pytest.mark.long
def test_a_sweep_killed_at_any_point_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "_CHUNK_RIG_S", 1000.0)  # as in the other process
    out = tmp_path / "run"
    arguments = command_line("small.yaml", "--out", str(out), "--jobs", "1", folder=tmp_path)
    with subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        until(lambda: any((out / "parts").glob("part-*.arrow")), "a part", patience_s=COMPILE_S)
        process.kill()
    kept = {part.name: part.stat().st_mtime_ns for part in (out / "parts").glob("part-*")}
    assert kept
    assert not (out / "sweep.parquet").exists()
    done = CliRunner().invoke(command, [str(out), "--resume", "--jobs", "1"])
    assert done.exit_code == 0, done.output
    whole = pq.read_table(out / "sweep.parquet")
    assert whole.column("case").to_pylist() == list(range(200))


@pytest.fixture(scope="module")
def cluster(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and two workers on loopback; return its address, and the workers."""
    folder = tmp_path_factory.mktemp("cluster")
    told = folder / "scheduler.json"
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    dask += ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(told)]

    def quietly(arguments: list[str]) -> subprocess.Popen[bytes]:
        nowhere = subprocess.DEVNULL
        return subprocess.Popen(arguments, stdout=nowhere, stderr=nowhere, cwd=folder)

    started = [quietly(dask)]
    try:
        until(told.exists)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1"]
        worker += ["--scheduler-file", str(told), "--no-nanny", "--no-dashboard"]
        worker += ["--host", "127.0.0.1"]
        started += [quietly(worker) for _ in range(2)]
        until(lambda: "address" in told.read_text())
        yield json.loads(told.read_text())["address"], started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_a_cluster_makes_the_same_table_though_a_worker_is_killed(
    sweep: Sweep, table: bytes, tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = cluster
    pids = {process.pid for process in workers}
    killed: list[int] = []
    with connected(address, lambda: False) as client:
        client.wait_for_workers(2, timeout=COMPILE_S)

        def with_a_death(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
            for judged in run_cluster(chunks, setting, client, lambda: False, print):
                if not killed:
                    killed.append(int(judged.worker.rpartition(":")[2]))
                    assert killed[0] in pids
                    os.kill(killed[0], signal.SIGKILL)
                yield judged

        run(sweep, tmp_path / "run", with_a_death)
    assert killed
    assert (tmp_path / "run" / "sweep.parquet").read_bytes() == table


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "tls://127.0.0.1:9"])
def test_a_cluster_that_is_not_there_is_bad_input(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr("rig.sweep.cluster._CONNECT_S", 0.3)
    with pytest.raises(ClusterError, match="no scheduler answers"):
        connected(address, lambda: False).__enter__()


@pytest.mark.filterwarnings("default")
def test_a_program_that_takes_the_connection_and_says_nothing_is_no_cluster(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.sweep.cluster._HANDSHAKE_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ClusterError, match="nothing came within"):
            connected(address, lambda: False).__enter__()
        with pytest.raises(ClusterError, match="stopped before it did"):
            connected(address, lambda: True).__enter__()


def test_a_scheduler_that_falls_silent_is_told_and_keeps_nobody_from_stopping(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for limit in ("_SILENT_S", "_PARTING_S", "_POLL_S"):
        monkeypatch.setattr(f"rig.sweep.cluster.{limit}", 0.05)
    forever = threading.Event()
    told: list[str] = []
    client: Any = SimpleNamespace(nthreads=forever.wait, cancel=lambda _: forever.wait())
    client.submit = lambda *_, **__: MagicMock()
    chunks: Any = iter("abcdefghi")
    setting: Any = None
    assert not list(run_cluster(chunks, setting, client, lambda: bool(told), told.append))
    assert told == ["the cluster's scheduler does not answer; waiting for it"]
    forever.set()


def answering(answer: Callable[[Cases], Any]) -> Any:
    """A client of a cluster of eight threads whose worker gives these answers at once."""

    def submit(_: Any, setting: Any, cases: Cases, **options: Any) -> Any:
        done = MagicMock(status="finished", result=lambda: answer(cases))
        done.add_done_callback = lambda call: call(done)
        return done

    client: Any = SimpleNamespace(nthreads=lambda: {"far": 8}, cancel=lambda _: None, submit=submit)
    return client


def result_of(cases: Cases, **changed: Any) -> Judged:
    """What a sound worker answers, with some columns or fields changed."""
    figures: dict[str, Any] = {
        "verdict": cases.faults, "right": np.ones(cases.numbers.size, np.bool_)
    }  # fmt: skip
    fields = {name: changed.pop(name) for name in ("chunk", "source") if name in changed}
    whole: dict[str, Any] = {"chunk": cases.chunk, "source": sources()} | fields
    kept = {name: column for name, column in (figures | changed).items() if column is not None}
    return Judged(figures=kept, process_s=0.0, wall_s=0.0, worker="far:1", **whole)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"chunk": 7}, "the result of other cases"),
        ({"right": np.ones(3, np.bool_)}, "columns that are not of its 16 cases"),
        ({"right": [True] * 16}, "columns that are not of its 16 cases"),
        ({"verdict": None}, "other columns than the sweep has"),
        ({"statistic": np.zeros(16)}, "other columns than the sweep has"),
        ({"verdict": np.full(16, "foreign")}, "verdicts that contradict themselves"),
        (None, "no result"),
    ],
)
def test_what_cannot_be_the_result_of_a_workers_cases_is_refused(
    sweep: Sweep, changed: dict[str, Any] | None, why: str
) -> None:
    first, second = (replace(draw(sweep, 0, 16), chunk=number) for number in range(2))

    def answer(cases: Cases) -> Any:
        if cases.chunk == 0:
            return result_of(cases)
        return changed if changed is None else result_of(cases, **changed)

    setting: Any = None
    client = answering(answer)
    results = run_cluster(iter([first, second]), setting, client, lambda: False, print)
    assert next(results).chunk == 0
    with pytest.raises(SweepError, match=f"answered with {why}; end it"):
        next(results)


def test_the_threads_of_a_cluster_are_counted_as_soon_as_it_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.sweep.cluster._LOOK_S", 600.0)
    wanted = _wanted(answering(lambda cases: None), print)
    until(lambda: next(wanted) == 24, "the count of threads")


def test_a_part_that_is_damaged_or_another_one_is_run_again(sweep: Sweep, tmp_path: Path) -> None:
    cases = draw(sweep, 0, 16)
    rows = rows_of(cases, dict(result_of(cases).figures))
    chunks = dict.fromkeys(range(4), 16)
    with SweepFolder(tmp_path / "run", sweep, resume=False) as folder:
        for number in range(4):
            folder.keep(number, rows)
        parts = sorted((tmp_path / "run" / "parts").iterdir())
        flipped = bytearray(parts[1].read_bytes())
        flipped[flipped.index(cases.columns["onset_s"].values[:1].tobytes())] ^= 1
        parts[1].write_bytes(flipped)
        shutil.copy(parts[0], parts[2])
        assert folder.done(chunks).keys() == {0, 3}


@pytest.mark.long
def test_a_worker_with_another_version_is_refused(sweep: Sweep, tmp_path: Path) -> None:
    def elsewhere(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        cases = next(chunks)
        assert cases is not None
        yield Judged(cases.chunk, {}, 0.0, 0.0, "0123", "far:1")

    with pytest.raises(SweepError, match="far:1 runs another version"):
        run(sweep, tmp_path / "run", elsewhere)
