"""An adaptive sweep draws near the wanted size, and is the same however its cases are run."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.sweep.words import limit_in_words
from rig.sweep import running
from rig.sweep.adaptive import power_curves
from rig.sweep.adaptive.batches import flows_of, positions
from rig.sweep.drawing import Cases
from rig.sweep.folder import SweepFolder
from rig.sweep.group import Setting
from rig.sweep.local import Chunks
from rig.sweep.run_cases import Judged, sources
from rig.sweep.running import Runner, chunks_of, is_complete, run_sweep
from rig.sweep.table import read_table

TEXT = """\
name: near
rig: ideal
filter: product
cases: 960
duration: 40 s
seed: 3
leaks:
  places: [external_leakage_1, internal_leakage]
  flow: {log_uniform: [0.01 L/min, 1 L/min]}
  onset: 15 s
  adaptive: {interval: 60 %}
motions:
  - {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
"""
TRUE = {"external_leakage_1": 0.05, "internal_leakage": 0.2}
"""Flow of which 95 of 100 are found by the judge of these tests, L/min."""


def load(folder: Path, text: str = TEXT) -> Sweep:
    (folder / "near.yaml").write_text(text)
    return load_sweep(folder / "near.yaml")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    return load(tmp_path_factory.mktemp("near"))


def judged(sweep: Sweep, cases: Cases) -> Judged:
    """Return a chunk whose leaks are found with a chance that follows from their flow."""
    assert sweep.leaks is not None
    found = np.ones(cases.numbers.size, np.bool_)
    coefficients = cases.columns["coefficient"].values.astype(np.float64)
    flows = flows_of(sweep.leaks, cases.faults, coefficients) / LITRE_PER_MINUTE
    for at, (number, fault) in enumerate(zip(cases.numbers, cases.faults, strict=True)):
        if fault in TRUE:
            log_odds = np.log(19.0) + 8.0 * np.log(flows[at] / TRUE[str(fault)])
            found[at] = np.random.default_rng(number).logistic() < log_odds
    return Judged(cases.chunk, {"right": found}, 0.0, 0.0, sources(), "here:1")


def one_by_one(sweep: Sweep) -> Runner:
    def run(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        for cases in chunks:
            assert cases is not None  # what is decided by the results before is known
            yield judged(sweep, cases)

    return run


def several_at_once(sweep: Sweep) -> Runner:
    """Return a runner with five chunks under way, of which the last one ends first."""

    def run(chunks: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        running: list[Cases] = []
        while True:
            while len(running) < 5 and (cases := next(chunks, None)) is not None:
                running.append(cases)
            if not running:
                return
            yield judged(sweep, running.pop())

    return run


def run(sweep: Sweep, folder: Path, runner: Runner, *, resume: bool = False) -> int:
    """Run a sweep, and return how many cases were run."""
    with SweepFolder(folder, sweep, resume=resume) as opened:
        timing = run_sweep(sweep, opened, runner, lambda: False, lambda _: None)
        if is_complete(sweep, opened):
            opened.finish()
    return timing.cases


@pytest.fixture(scope="module")
def folder(sweep: Sweep, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the sweep, whose chunks were run one after another."""
    path = tmp_path_factory.mktemp("alone") / "run"
    run(sweep, path, one_by_one(sweep))
    return path


def test_it_ends_by_itself_with_the_sizes_that_are_found(sweep: Sweep, folder: Path) -> None:
    table = read_table(folder / "sweep.parquet")
    assert table.num_rows < sweep.cases
    assert table.num_rows % 96 == 0
    assert table.column("case").to_pylist() == list(range(table.num_rows))
    for place, curve in power_curves(sweep, table).items():
        assert curve.interval_m3_per_s is not None
        low, high = (end / LITRE_PER_MINUTE for end in curve.interval_m3_per_s)
        assert low <= TRUE[place] <= high
        assert high / low <= 1.6
        assert f"({low:.3g} L/min to {high:.3g} L/min)" in limit_in_words(curve)


def test_draws_come_nearer_to_the_wanted_size(sweep: Sweep, folder: Path) -> None:
    table = read_table(folder / "sweep.parquet")
    assert sweep.leaks is not None
    faults = np.array(table.column("fault").to_pylist())
    flows = flows_of(sweep.leaks, faults, table.column("coefficient").to_numpy())
    parts = positions(sweep.leaks.size, flows)
    first, later = (
        parts[at][faults[at] == "internal_leakage"] for at in (slice(0, 96), slice(192, 288))
    )
    # The first batch is spread over the whole range, a leak in each of as many pieces.
    assert sorted((first * first.size).astype(int)) == list(range(first.size))
    assert np.ptp(later) < 0.5 * np.ptp(first)


def test_the_table_does_not_depend_on_what_runs_at_once_and_ends_first(
    sweep: Sweep, folder: Path, tmp_path: Path
) -> None:
    run(sweep, tmp_path / "run", several_at_once(sweep))
    expected = (folder / "sweep.parquet").read_bytes()
    assert (tmp_path / "run" / "sweep.parquet").read_bytes() == expected


@pytest.mark.parametrize("chunks", [2, 7, 9])
def test_an_interrupted_sweep_goes_on_to_the_same_table(
    sweep: Sweep, folder: Path, tmp_path: Path, chunks: int
) -> None:
    def stops(given: Chunks, setting: Setting, stopped: object) -> Iterator[Judged]:
        yield from islice(several_at_once(sweep)(given, setting, lambda: False), chunks)

    path = tmp_path / "run"
    ran = run(sweep, path, stops)
    assert not (path / "sweep.parquet").exists()
    min((path / "parts").glob("part-*")).write_bytes(b"cut off")  # it is run again
    ran += run(sweep, path, several_at_once(sweep), resume=True)
    assert (path / "sweep.parquet").read_bytes() == (folder / "sweep.parquet").read_bytes()
    assert ran == read_table(path / "sweep.parquet").num_rows + running.chunk_size(sweep)
    assert run(sweep, path, several_at_once(sweep), resume=True) == 0


def test_a_size_below_all_that_were_drawn_is_told_as_such(tmp_path: Path) -> None:
    sweep = load(tmp_path, TEXT.replace("[0.01 L/min,", "[0.4 L/min,").replace("960", "288"))
    run(sweep, tmp_path / "run", one_by_one(sweep))
    curves = power_curves(sweep, read_table(tmp_path / "run" / "sweep.parquet"))
    at_most = curves["external_leakage_1"].at_most_m3_per_s
    assert at_most is not None
    # All were found, and a place is done 60 % above the least flow.
    assert 0.4 < at_most / LITRE_PER_MINUTE <= 0.64
    told = limit_in_words(curves["external_leakage_1"])
    assert told == f"not known: {at_most / LITRE_PER_MINUTE:.3g} L/min or less"


def test_without_an_interval_all_cases_are_run(tmp_path: Path) -> None:
    sweep = load(tmp_path, TEXT.replace("{interval: 60 %}", "{found: 80 %}").replace("960", "232"))
    assert run(sweep, tmp_path / "run", one_by_one(sweep)) == 232
    assert list(chunks_of(sweep).values()) == [24] * 9 + [16]
