"""The contestants of the filter benchmark compute the same filter."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

from rig.plant import NOMINAL
from tools.bench import product as product_bench
from tools.bench.filters import (
    CONTESTS,
    Contest,
    Record,
    compile_reference,
    disagreement,
    filterpy_filter,
    measure,
    simulated_record,
    table,
)
from tools.bench.product import product_record

pytestmark = pytest.mark.long

EACH_FILTER = pytest.mark.parametrize("contest", CONTESTS, ids=lambda contest: contest.name)


@pytest.fixture(scope="module")
def record() -> Record:
    return simulated_record(1200)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    found = compile_reference(tmp_path_factory.mktemp("reference"))
    if found is None:
        pytest.skip("gcc is not installed")
    return found


@EACH_FILTER
def test_the_c_reference_computes_the_same_filter(
    contest: Contest, record: Record, library: ctypes.CDLL
) -> None:
    assert disagreement(library, contest, record) < 1e-9


def test_the_c_reference_computes_the_same_product_filter(
    record: Record, library: ctypes.CDLL
) -> None:
    product = product_record(record.command, record.measured, record.truth)
    assert product_bench.disagreement(library, product) < 1e-7


@EACH_FILTER
def test_filterpy_computes_the_same_filter(contest: Contest, record: Record) -> None:
    n = contest.size
    sigma = np.array([1e-7, 1e3, 1e3, 1e-3, 1e-2, 1e-4, 1e2])[:n]
    rows = np.eye(7)[[3, 1, 2], :n]
    x, P, out = record.truth[600, :n].copy(), np.diag(sigma**2), np.empty(9)
    ekf = filterpy_filter(contest)
    ekf.x, ekf.P = x.copy(), P.copy()
    for k in range(600, 605):
        contest.compiled(x, P, record.command[k : k + 1], record.measured[k : k + 1], NOMINAL, out)
        ekf.predict(record.command[k])
        ekf.update(record.measured[k], lambda _: rows, lambda state: rows @ state)
    deviation = np.sqrt(np.diag(P))
    assert np.max(np.abs(x - ekf.x) / deviation) < 1e-9
    assert np.max(np.abs(P - ekf.P) / np.outer(deviation, deviation)) < 1e-9


def test_without_gcc_the_reference_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert compile_reference(tmp_path) is None


def test_without_the_reference_filterpy_is_still_compared(record: Record) -> None:
    times = measure(1, record, None)
    assert {name: set(by_who) for name, by_who in times.items()} == {
        "thesis-6": {"ours", "filterpy"},
        "thesis-7": {"ours", "filterpy"},
        "product": {"ours"},
    }
    assert list(table(times).columns[2].cells) == ["-"] * 3
