"""Times the filters and compares them with references in C; the thesis's also with filterpy.

`python -m tools.bench.filters` runs all implementations in turn over the same simulated record, for
several rounds. It prints the median times, and the ratios of the times within a round. Times are
processor times of the thread, so that other programs disturb them little. The filters and the C
references loop over the whole record in one compiled call. The C code is compiled by gcc; without
gcc, a message says that the references are left out.
"""

import argparse
import ctypes
import shutil
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from estimator.filters import thesis
from rig.jit import njit
from rig.plant import NOMINAL, Model, Parameters
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate
from tools.thesis_linearised import (
    thesis6_jacobian,
    thesis6_predict,
    thesis7_jacobian,
    thesis7_predict,
)

from . import product as product_bench
from .product import product_record

Array = NDArray[np.float64]

C_SOURCE: Final = Path(__file__).parent / "c" / "thesis_filters.c"
C_FLAGS: Final = ("-O3", "-march=native", "-shared", "-fPIC")

PARAMETER_FIELDS: Final = (
    "piston_area",
    "moving_mass",
    "stroke_min",
    "stroke_max",
    "line_volume_1",
    "line_volume_2",
    "bulk_modulus",
    "density",
    "supply_pressure",
    "return_pressure",
    "discharge_coefficient",
    "area_gradient",
    "valve_gain",
    "valve_natural_frequency",
    "valve_damping",
    "stiction",
    "coulomb",
    "stribeck_velocity",
    "viscous",
    "stick_velocity",
)
"""Names of the parameters in the order of `struct parameters` in the C reference."""

SAMPLES: Final = 20_000
FILTERPY_SAMPLES: Final = 1_000
H: Final = np.eye(7)[[3, 1, 2]]


@njit(cache=True, error_model="numpy")
def run_thesis6(x, P, command, measured, parameters, out):
    """Run the filter thesis-6 over a record of n samples.

    Args:
        x: (6,) states; updated in place.
        P: (6, 6) covariance; updated in place.
        command: (n,) V, before each sample.
        measured: (n, 3) position, p1 and p2, SI.
        parameters: of the model.
        out: (9,) receives the outputs of the last sample.
    """
    for k in range(command.size):
        thesis.thesis6_step(
            x, P, command[k], measured[k, 0], measured[k, 1], measured[k, 2], parameters, out
        )


@njit(cache=True, error_model="numpy")
def run_thesis7(x, P, command, measured, parameters, out):
    """Run the filter thesis-7 over a record; see `run_thesis6`, with 7 states instead of 6."""
    for k in range(command.size):
        thesis.thesis7_step(
            x, P, command[k], measured[k, 0], measured[k, 1], measured[k, 2], parameters, out
        )


@dataclass(frozen=True)
class Contest:
    """One of the thesis's filters, with its implementations that are compared.

    Attributes:
        name: of the filter.
        with_load: whether the load is a state.
        compiled: our implementation, which runs over a whole record.
        reference: name of the C function that does the same.
        predict, jacobian: our compiled prediction and Jacobian, which filterpy's filter uses.
        process_noise, measurement_noise: variances.
    """

    name: str
    with_load: bool
    compiled: Callable[..., None]
    reference: str
    predict: Callable[..., Array]
    jacobian: Callable[..., Array]
    process_noise: tuple[float, ...]
    measurement_noise: tuple[float, ...]

    @property
    def size(self) -> int:
        """The number of states."""
        return 7 if self.with_load else 6


CONTESTS: Final = (
    Contest(
        "thesis-6",
        False,
        run_thesis6,
        "thesis6_run",
        thesis6_predict,
        thesis6_jacobian,
        thesis.THESIS6_PROCESS_NOISE,
        thesis.THESIS6_MEASUREMENT_NOISE,
    ),
    Contest(
        "thesis-7",
        True,
        run_thesis7,
        "thesis7_run",
        thesis7_predict,
        thesis7_jacobian,
        thesis.THESIS7_PROCESS_NOISE,
        thesis.THESIS7_MEASUREMENT_NOISE,
    ),
)


@dataclass(frozen=True)
class Record:
    """A simulated run over which the filters are run.

    Attributes:
        command: (n,) V, before each sample.
        measured: (n, 3) position, p1 and p2, SI.
        truth: (n + 1, 7) true states, SI; row 0 is before the first sample. The columns are spool,
            pressures 1 and 2, position, velocity, spool velocity and load.
    """

    command: Array
    measured: Array
    truth: Array


def simulated_record(samples: int = SAMPLES) -> Record:
    """Return a record of a healthy rig in an open-loop sine of 3 V and 1 Hz, with sensor noise."""
    command = 3.0 * np.sin(2.0 * np.pi * 1e-3 * np.arange(samples + 1))
    states = simulate(Model(), command, position=0.3)
    p1, p2 = states["pressure_1"], states["pressure_2"]
    order = ("spool", "pressure_1", "pressure_2", "position", "velocity", "spool_velocity")
    load = NOMINAL.piston_area * (p1 - p2)
    truth = np.column_stack([*(states[name] for name in order), load])
    noise = np.random.default_rng(1).normal(size=(samples, 3))
    sigma = np.array([DATA_SHEET.position_resolution, *[DATA_SHEET.pressure_noise] * 2])
    measured = truth[1:, [3, 1, 2]] + sigma * noise
    return Record(command[:-1].copy(), np.ascontiguousarray(measured), truth)


def c_parameters(parameters: Parameters = NOMINAL) -> Array:
    """Return the parameters (20,), SI, in the order of the C reference's struct."""
    return np.array([getattr(parameters, name) for name in PARAMETER_FIELDS])


def compile_reference(folder: Path) -> ctypes.CDLL | None:
    """Compile the C references into `folder` and return the library; None if there is no gcc.

    Raises:
        CalledProcessError: gcc refuses the sources.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        return None
    target = folder / "filters.so"
    sources = (str(C_SOURCE), str(product_bench.C_SOURCE))
    subprocess.run([gcc, *C_FLAGS, "-o", str(target), *sources, "-lm"], check=True)
    return ctypes.CDLL(str(target))


def run_reference(
    library: ctypes.CDLL, contest: Contest, x: Array, P: Array, record: Record, out: Array
) -> None:
    """Run the C reference over a record in one call, with the nominal parameters.

    `x` (6 or 7,) and `P`, square, are updated in place; `out` (9,) receives the outputs of the last
    sample.
    """
    run = getattr(library, contest.reference)
    constants = c_parameters()
    arrays = (x, P, record.command, record.measured, constants, out)
    run(ctypes.c_long(record.command.size), *(ctypes.c_void_p(a.ctypes.data) for a in arrays))


def disagreement(library: ctypes.CDLL, contest: Contest, record: Record, length: int = 5) -> float:
    """Return the largest relative difference of x, P and outputs between ours and the C reference.

    Differences of states are relative to the state plus its standard deviation, those of P and of
    innovations and residuals to standard deviations, those of variances to themselves. Both filters
    start anew from the true state every `length` samples, because over longer times the thesis's
    filters, as printed, diverge and rounding errors grow with them.
    """
    n = contest.size
    sigma = np.array([1e-7, 1e3, 1e3, 1e-3, 1e-2, 1e-4, 1e2])[:n]
    worst = 0.0
    for start in range(0, record.command.size - length, length):
        part = slice(start, start + length)
        piece = Record(record.command[part], record.measured[part], record.truth[part])
        x, P, out = record.truth[start, :n].copy(), np.diag(sigma**2), np.empty(9)
        c_x, covariance, c_out = x.copy(), P.copy(), out.copy()
        contest.compiled(x, P, piece.command, piece.measured, NOMINAL, out)
        run_reference(library, contest, c_x, covariance, piece, c_out)
        deviation, spread = np.sqrt(np.diag(P)), np.sqrt(out[6:9])
        worst = max(
            worst,
            np.max(np.abs(x - c_x) / (np.abs(x) + deviation)),
            np.max(np.abs(P - covariance) / np.outer(deviation, deviation)),
            np.max(np.abs(out - c_out)[:6] / np.tile(spread, 2)),
            np.max(np.abs(out - c_out)[6:] / out[6:]),
        )
    return worst


def filterpy_filter(contest: Contest) -> Any:
    """Return filterpy's EKF with the filter's tuning and our compiled prediction and Jacobian.

    It begins with the x0 and P0 that the thesis prints, and assumes the nominal parameters.
    """
    ekf = ExtendedKalmanFilter(dim_x=contest.size, dim_z=3)
    ekf.x, ekf.P = thesis.initial_state(contest.with_load)
    ekf.Q, ekf.R = np.diag(contest.process_noise), np.diag(contest.measurement_noise)

    def predict_x(u: float = 0.0) -> None:
        ekf.F = contest.jacobian(ekf.x, NOMINAL)
        ekf.x = contest.predict(ekf.x, u, NOMINAL)

    ekf.predict_x = predict_x
    return ekf


def run_filterpy(contest: Contest, record: Record, samples: int) -> None:
    """Run filterpy's EKF over the first `samples` samples of a record."""
    ekf, rows = filterpy_filter(contest), H[:, : contest.size]
    with warnings.catch_warnings():
        # The printed P0 (a spool known to 100 m) makes the first innovation covariances singular.
        warnings.filterwarnings("ignore", message="An ill-conditioned matrix detected")
        for k in range(samples):
            ekf.predict(record.command[k])
            ekf.update(record.measured[k], lambda _: rows, lambda x: rows @ x)


def _timed(run: Callable[[], None], samples: int) -> float:
    """Run a function, and return the thread's processor time for each of its samples, ns."""
    start = time.thread_time_ns()
    run()
    return (time.thread_time_ns() - start) / samples


def _contestants(
    contest: Contest, record: Record, library: ctypes.CDLL | None
) -> dict[str, Callable[[], float]]:
    """Return, by implementation, a function that runs it once and returns its time, ns a sample.

    Each run begins with the x0 and P0 that the thesis prints.
    """

    def ours() -> float:
        x, P = thesis.initial_state(contest.with_load)
        out = np.empty(9)
        run = contest.compiled
        return _timed(
            lambda: run(x, P, record.command, record.measured, NOMINAL, out), record.command.size
        )

    def reference(library: ctypes.CDLL) -> float:
        x, P = thesis.initial_state(contest.with_load)
        out = np.empty(9)
        return _timed(
            lambda: run_reference(library, contest, x, P, record, out), record.command.size
        )

    def textbook() -> float:
        return _timed(lambda: run_filterpy(contest, record, FILTERPY_SAMPLES), FILTERPY_SAMPLES)

    found: dict[str, Callable[[], float]] = {"ours": ours}
    if library is not None:
        found["C"] = lambda: reference(library)
    found["filterpy"] = textbook
    return found


def measure(
    rounds: int, record: Record, library: ctypes.CDLL | None
) -> dict[str, dict[str, Array]]:
    """Return the times by filter and implementation, (rounds,) each, in ns a sample.

    In every round, each implementation of each filter runs once. If `library` is None, there are no
    C references; the product filter has no implementation by filterpy.
    """
    runs = {contest.name: _contestants(contest, record, library) for contest in CONTESTS}
    product = product_record(record.command, record.measured, record.truth)
    runs["product"] = product_bench.contestants(product, library)
    for contestants in runs.values():
        contestants["ours"]()  # compiles, or loads the cache
    times: dict[str, dict[str, list[float]]] = {
        name: {who: [] for who in contestants} for name, contestants in runs.items()
    }
    for _ in range(rounds):
        for name, contestants in runs.items():
            for who, run in contestants.items():
                times[name][who].append(run())
    return {
        name: {who: np.array(series) for who, series in by_who.items()}
        for name, by_who in times.items()
    }


def _spread(ratio: Array) -> str:
    low, middle, high = np.percentile(ratio, [25, 50, 75])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def table(times: dict[str, dict[str, Array]]) -> Table:
    """Return the table of median times in ns a sample, and of ratios with their quartiles.

    A ratio is taken within each round; a dash stands for an implementation that was not run.
    """
    result = Table("filter", "ours ns", "C ns", "filterpy ns", "ours / C", "filterpy / ours")
    for name, by_who in times.items():
        ours, reference, textbook = by_who["ours"], by_who.get("C"), by_who.get("filterpy")
        result.add_row(
            name,
            f"{np.median(ours):.1f}",
            "-" if reference is None else f"{np.median(reference):.1f}",
            "-" if textbook is None else f"{np.median(textbook):.0f}",
            "-" if reference is None else _spread(ours / reference),
            "-" if textbook is None else _spread(textbook / ours),
        )
    return result


def main() -> None:
    """Run the benchmark; print its table, and how much the C references differ from ours."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=51, help="interleaved rounds (default 51)")
    rounds = parser.parse_args().rounds
    console = Console()
    record = simulated_record()
    with tempfile.TemporaryDirectory() as folder:
        library = compile_reference(Path(folder))
        if library is None:
            console.print("gcc is not installed: the C reference is skipped.")
        else:
            for contest in CONTESTS:
                difference = disagreement(library, contest, record)
                console.print(
                    f"{contest.name}: C and ours differ by {difference:.1e} at most (relative)"
                )
            product = product_record(record.command, record.measured, record.truth)
            difference = product_bench.disagreement(library, product)
            console.print(f"product: C and ours differ by {difference:.1e} standard deviations")
        console.print(table(measure(rounds, record, library)))


if __name__ == "__main__":
    main()
