"""Null and noise are told from a ram that is held."""

import numpy as np
import pytest

from rig.plant import TICK
from rig.runner.commissioning.standing import LOOKED_AT, standing_of

TICKS = 5000
RANDOM = np.random.default_rng(7)


def rows(**columns: np.ndarray) -> np.ndarray:
    none = np.full(TICKS, np.nan)
    return np.column_stack([columns.get(name, none) for name in LOOKED_AT])


def test_noise_is_told_to_its_error_also_upon_a_drift() -> None:
    drifting = 7e6 + np.linspace(0.0, 1e6, TICKS) + 45e3 * RANDOM.standard_normal(TICKS)
    noise = standing_of(rows(pressure_1_Pa=drifting), TICK).noise["pressure_1_Pa"]
    assert noise.deviation == pytest.approx(45e3, rel=4.0 * noise.error)
    assert noise.error < 0.02


def test_a_meter_that_repeats_its_values_counts_each_once() -> None:
    flow = np.repeat(1e-6 + 3e-7 * RANDOM.standard_normal(TICKS // 100), 100)
    noise = standing_of(rows(flow_1_m3_per_s=flow), TICK).noise["flow_1_m3_per_s"]
    assert noise.deviation == pytest.approx(3e-7, rel=4.0 * noise.error)
    assert noise.error > 0.05


def test_noise_that_is_cut_off_at_an_end_of_the_range_is_not_told() -> None:
    load = np.maximum(22.0 * RANDOM.standard_normal(TICKS), 0.0)
    found = standing_of(rows(load_N=load, spool_m=np.zeros(TICKS)), TICK)
    assert not found.noise


def test_what_reads_nothing_is_named() -> None:
    found = standing_of(rows(position_m=np.full(TICKS, 0.3)), TICK)
    assert "position_m" not in found.silent
    assert {"pressure_1_Pa", "spool_m"} <= set(found.silent)


def test_null_is_the_command_at_the_end() -> None:
    command = np.concatenate([np.full(TICKS - 2000, 1.0), np.full(2000, -0.054)])
    assert standing_of(rows(command_V=command), TICK).null_V == pytest.approx(-0.054)
