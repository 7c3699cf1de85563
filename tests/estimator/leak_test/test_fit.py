"""Leaks of a locked cylinder, from soaks that follow the fit's own laws."""

import numpy as np
import pytest

from estimator.leak_test import (
    BlockingLeak,
    LeakTestError,
    Soak,
    fit_leaks,
    foreseen_limits,
    levels_of,
    port_pressures,
)
from rig.plant import DATA_SHEET, LITRE_PER_MINUTE, NOMINAL, chamber_volumes

LEVELS = levels_of(NOMINAL)
BLOCKING = BlockingLeak(1e-4 * LITRE_PER_MINUTE, 1e7)
POSITION = 0.3


def soaks(flow_1: float = 0.0, warming: float = 0.0) -> list[Soak]:
    """Return noiseless soaks with a leak (m^3/s) out of chamber 1, in oil that warms (K/s)."""
    found = []
    volumes = chamber_volumes(POSITION, NOMINAL)
    before = (6.9e6, 6.9e6)
    for number, levels in enumerate(LEVELS.soaks):
        time_s = 9.0 * number + np.arange(0.0, 6.0, 0.005)
        since = time_s - time_s[0]
        leak = flow_1 * (levels[0] / LEVELS.pressure) ** 0.75
        rates = [
            NOMINAL.bulk_modulus * (7e-4 * warming - lost / volume)
            for lost, volume in zip((leak, 0.0), volumes, strict=True)
        ]
        p1, p2 = (p + rate * since for p, rate in zip(levels, rates, strict=True))
        ports = port_pressures(number, NOMINAL.supply_pressure, NOMINAL.return_pressure)
        steps = levels[0] - before[0], levels[1] - before[1]
        still = np.full_like(time_s, POSITION)
        found.append(Soak(time_s, p1, p2, still, *ports, steps, 1.0))
        before = float(p1[-1]), float(p2[-1])
    return found


def test_a_leak_out_of_chamber_1_is_found_there_and_nowhere_else() -> None:
    flow = 1e-3 * LITRE_PER_MINUTE
    result = fit_leaks(soaks(flow), LEVELS, NOMINAL, DATA_SHEET, BLOCKING)
    assert [each.is_leak for each in result.findings] == [True, False, False]
    assert result.findings[0].lower < flow < result.findings[0].upper


@pytest.mark.parametrize("warming", [-0.03, 0.03])
def test_oil_whose_temperature_drifts_is_no_leak(warming: float) -> None:
    result = fit_leaks(soaks(warming=warming), LEVELS, NOMINAL, DATA_SHEET, BLOCKING)
    assert not any(each.is_leak for each in result.findings)


def test_the_limit_foreseen_is_a_thousandth_of_a_litre_a_minute_or_less() -> None:
    limits = foreseen_limits(LEVELS, NOMINAL, DATA_SHEET, BLOCKING, POSITION, 200.0)
    assert all(limit <= 1e-3 * LITRE_PER_MINUTE for limit in limits)


def test_valves_that_may_leak_more_hide_larger_leaks() -> None:
    worse = BlockingLeak(10.0 * BLOCKING.flow, BLOCKING.pressure)
    tight, leaky = (
        foreseen_limits(LEVELS, NOMINAL, DATA_SHEET, each, POSITION, 200.0)
        for each in (BLOCKING, worse)
    )
    assert all(more > less for more, less in zip(leaky, tight, strict=True))


def test_a_chamber_that_loses_its_pressure_at_once_is_not_judged() -> None:
    with pytest.raises(LeakTestError, match=r"soak \d: the pressure was above 1 MPa for"):
        fit_leaks(soaks(0.2 * LITRE_PER_MINUTE), LEVELS, NOMINAL, DATA_SHEET, BLOCKING)
