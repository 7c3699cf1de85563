"""The three leaks of a locked cylinder, fitted together with all known disturbances."""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LEAKS, Parameters, SensorParameters

from .columns import (
    BLOCKING_COLUMNS,
    BULK_MODULUS,
    LEAK_LAW,
    BlockingLeak,
    disturbances,
    leak_columns,
)
from .soaks import LEAST_BLOCKS, SOAK_S, Account, Levels, Soak, account_of

Array = NDArray[np.float64]

FALSE_ALARMS: Final = 0.01
"""Share of the tests of a tight cylinder that accuse it, in any of the three places."""
THRESHOLD: Final = 2.713
"""Quantile of the standard normal distribution at 1 - `FALSE_ALARMS` / 3; a place has a third."""
FOUND_IN_95: Final = 1.645
"""Its quantile at 0.95."""
INTERVAL: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""
_SCALED: Final = hypot(BULK_MODULUS, LEAK_LAW)
"""Tolerance of a flow by what scales it, as a share of it."""
_UNSCALED: Final = 1.0 - (FOUND_IN_95 * _SCALED) ** 2
SMALLEST: Final = (
    THRESHOLD + sqrt(THRESHOLD**2 - _UNSCALED * (THRESHOLD**2 - FOUND_IN_95**2))
) / _UNSCALED
"""The leak that 95 of 100 tests find, in standard errors s (5.15). The estimate of a leak of L s is
normal with mean L s and variance s^2 (1 + `_SCALED`^2 L^2), and is above `THRESHOLD` in 95 of 100
if L = `THRESHOLD` + `FOUND_IN_95` sqrt(1 + `_SCALED`^2 L^2), which is solved here for L."""

_FREE_FLOW: Final = 1e-4
"""Tolerance of a leak before the test, m^3/s (6 L/min): so large that it has no influence."""


class LeakTestError(ValueError):
    """A test cannot be evaluated.

    Attributes:
        problems: what is wrong, for each problem one sentence.
    """

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problems = (problem,)


@dataclass(frozen=True)
class LeakFinding:
    """What a test tells of one place.

    Attributes:
        name: the leak, one of `rig.plant.LEAKS`.
        flow: estimated flow in m^3/s at the stated pressure.
        standard_error: its standard error in m^3/s, without bulk modulus and leak law.
        lower: lower end of the 95 % interval, m^3/s, with the tolerances of both.
        upper: its upper end.
        is_leak: whether the place leaks, at the rate `FALSE_ALARMS` for all places together.
        smallest: smallest leak in m^3/s that 95 of 100 tests like this one would have found.
        limited_by: the disturbance that contributes most to the standard error.
    """

    name: str
    flow: float
    standard_error: float
    lower: float
    upper: float
    is_leak: bool
    smallest: float
    limited_by: str


@dataclass(frozen=True)
class BlockingFinding:
    """What a test tells of the leak of one shut blocking valve, within its data sheet.

    Attributes:
        chamber: the chamber in whose line it is, 1 or 2.
        flow: estimated flow in m^3/s at the pressure difference of the data sheet.
        lower: lower end of the 95 % interval, m^3/s; not below 0.
        upper: its upper end; not above the data sheet's greatest leak.
    """

    chamber: int
    flow: float
    lower: float
    upper: float


@dataclass(frozen=True)
class LeakTestResult:
    """What a test tells.

    Attributes:
        levels: pressures of the test.
        findings: one for each place, in the order of `rig.plant.LEAKS`.
        misfit: scatter of what is left, in what is expected of the sensors; 1 where all is as
            expected. Above 1 the standard errors are larger by it.
        blocking: what it tells of the blocking valves' own leaks.
    """

    levels: Levels
    findings: tuple[LeakFinding, ...]
    misfit: float
    blocking: tuple[BlockingFinding, ...] = ()


def fit_leaks(
    soaks: list[Soak],
    levels: Levels,
    par: Parameters,
    sensors: SensorParameters,
    blocking: BlockingLeak,
) -> LeakTestResult:
    """Return the three leaks of a cylinder by the soaks of a test.

    The accounts are a sum of leaks, disturbances within their tolerances, and the noise of the
    sensors; that is solved by least squares with the tolerances as prior standard deviations.

    Args:
        soaks: the soaks, in the order of `levels.soaks`.
        levels: pressures of the test.
        par: parameters of the assumed model.
        sensors: data sheet of the transducers.
        blocking: data sheet of the blocking valves.

    Raises:
        LeakTestError: a soak is too short, or a chamber did not keep its pressure.
    """
    accounts = [account_of(soak, par) for soak in soaks]
    for number, account in enumerate(accounts, start=1):
        if account.time_s.size < LEAST_BLOCKS:
            held = account.time_s.size * SOAK_S / 24.0
            raise LeakTestError(
                f"soak {number}: the pressure was above 1 MPa for {held:.1f} s only, and at least "
                "1.5 s are needed; the leak is too large for this test, or a blocking valve is not "
                "shut: look for it by a motion (`rig run`) first"
            )
    columns = list(disturbances(soaks, accounts, par, sensors, blocking))
    leaks = list(leak_columns(accounts, levels))
    design = [*leaks, *(np.concatenate(each.effect) for each in columns), *_offsets(accounts)]
    scale = np.array(
        [_FREE_FLOW] * 3 + [each.tolerance for each in columns] + [1e-4] * (2 * len(accounts))
    )
    whiten = [_whitening(account, par, sensors) for account in accounts]
    rows = np.column_stack([_whitened(column, accounts, whiten) for column in design]) * scale
    measured = np.concatenate([each.lost for each in accounts])
    for each in columns:
        measured = measured - each.expected * np.concatenate(each.effect)
    lost = _whitened(measured, accounts, whiten)
    # Columns that are scaled to their tolerances have the prior N(0, 1).
    inverse = np.linalg.inv(rows.T @ rows + np.eye(scale.size))
    solved = inverse @ (rows.T @ lost)
    left = lost - rows @ solved
    freedom = lost.size - 3 - 2 * len(accounts)
    misfit = sqrt(float(left @ left) / freedom)
    names = [*LEAKS, *(each.name for each in columns)]
    # How much the estimates of the leaks change by one tolerance of each quantity.
    carried = -inverse @ (rows.T @ rows) + np.eye(scale.size)
    findings = []
    for i, name in enumerate(LEAKS):
        flow = float(solved[i] * scale[i])
        error = float(sqrt(inverse[i, i]) * scale[i] * max(1.0, misfit))
        half = INTERVAL * hypot(error, BULK_MODULUS * flow, LEAK_LAW * flow)
        most = 3 + int(np.argmax(np.abs(carried[i, 3 : len(names)])))
        findings.append(
            LeakFinding(
                name, flow, error, flow - half, flow + half, flow > THRESHOLD * error,
                SMALLEST * error, names[most],
            )
        )  # fmt: skip
    valves = []
    for i, each in enumerate(columns, start=3):
        if each.name in BLOCKING_COLUMNS:
            chamber = BLOCKING_COLUMNS.index(each.name) + 1
            flow = float(each.expected + solved[i] * scale[i])
            half = float(INTERVAL * sqrt(inverse[i, i]) * scale[i] * max(1.0, misfit))
            inside = (min(max(v, 0.0), blocking.flow) for v in (flow, flow - half, flow + half))
            valves.append(BlockingFinding(chamber, *inside))
    return LeakTestResult(levels, tuple(findings), misfit, tuple(valves))


def foreseen_limits(
    levels: Levels,
    par: Parameters,
    sensors: SensorParameters,
    blocking: BlockingLeak,
    position: float,
    rate_hz: float,
) -> tuple[float, ...]:
    """Return the smallest leaks in m^3/s that 95 of 100 tests find, computed before any test.

    They are those of `fit_leaks` on a tight cylinder whose pressures stay where they are.

    Args:
        levels: pressures of the test.
        par: parameters of the assumed model.
        sensors: data sheet of the transducers.
        blocking: data sheet of the blocking valves.
        position: where the ram stands, m.
        rate_hz: samples a second.
    """
    soaks = []
    before = (0.5 * par.supply_pressure,) * 2
    time_s = np.arange(round(SOAK_S * rate_hz)) / rate_hz
    for number, (p1, p2) in enumerate(levels.soaks):
        flat = np.ones_like(time_s)
        ports = port_pressures(number, par.supply_pressure, par.return_pressure)
        steps = p1 - before[0], p2 - before[1]
        begun = 9.0 * number
        soaks.append(
            Soak(time_s + begun, p1 * flat, p2 * flat, position * flat, *ports, steps, 1.5)
        )
        before = p1, p2
    found = fit_leaks(soaks, levels, par, sensors, blocking)
    return tuple(each.smallest for each in found.findings)


def port_pressures(number: int, supply: float, back: float) -> tuple[float, float]:
    """Return the pressures in Pa at ports 1 and 2 of the servovalve during a soak.

    The spool is a little open to one side, which differs from soak to soak: so the leak of a
    blocking valve changes otherwise than the leak of its chamber, and the two can be told apart.
    The first soak has the supply at port 1, the others at port 2.
    """
    return (supply, back) if number == 0 else (back, supply)


def _offsets(accounts: list[Account]) -> list[Array]:
    """Return a column for each chamber and soak, as the first block has noise like all others."""
    columns = []
    for number in range(len(accounts)):
        for chamber in (0, 1):
            parts = [np.zeros_like(each.lost) for each in accounts]
            parts[number][:, chamber] = 1.0
            columns.append(np.concatenate(parts))
    return columns


def _whitening(account: Account, par: Parameters, sensors: SensorParameters) -> Array:
    """Return float64 (2, 2), which makes the noise of a block's two accounts independent and 1.

    The noise of both pressures is independent. A reading that is rounded to a count moves oil from
    one chamber's account to the other's; a ram that stands keeps that error, so it is not averaged.
    """
    pressure = sensors.pressure_noise / sqrt(account.samples)
    each = (pressure * account.compliance.mean(axis=0)) ** 2
    way = (par.piston_area * sensors.position_resolution) ** 2 / 12.0
    covariance = np.array([[each[0] + way, -way], [-way, each[1] + way]])
    whitening: Array = np.linalg.inv(np.linalg.cholesky(covariance))
    return whitening


def _whitened(column: Array, accounts: list[Account], whiten: list[Array]) -> Array:
    """Return a column (rows, 2) of all soaks as float64 (2 rows,) in units of the noise."""
    ends = np.cumsum([each.time_s.size for each in accounts])[:-1]
    parts = np.split(column, ends)
    return np.concatenate([(part @ w.T).ravel() for part, w in zip(parts, whiten, strict=True)])
