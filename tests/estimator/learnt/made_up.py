"""Made-up accounts and noise for tests of what was learnt."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from estimator.accounts.flow import AccountBlock
from estimator.learnt.noise import LearntNoise, RegimeNoise
from estimator.learnt.tail import Tail
from tests.estimator.leaks.test_leak_statistic import blocks_of_an_exact_model

SEEN = Tail(3.0, 1.0, 10, 5.0)
LEARNT = MappingProxyType({"moving": RegimeNoise(600.0, 0.1, 0.0, 0.0)})


def noise(tail: Tail = SEEN, regimes: Mapping[str, RegimeNoise] = LEARNT) -> LearntNoise:
    """Return learnt noise; `moving` is the only regime unless others are given."""
    return LearntNoise(regimes, (0.0, 0.0, 0.0, 0.01, 0.01), tail)


def moving(block: AccountBlock, travel: float = 0.02, start: float = 0.3) -> AccountBlock:
    """Return a block in which the ram travels, by 2 cm in half a second, unloaded."""
    sizes = block.sizes.copy()
    sizes[2] = 1000.0  # Pa^0.5: 1 MPa across the piston.
    return replace(block, position_range=(start, start + travel), sizes=sizes)


def moving_blocks(count: int, seed: int, factor: float = 0.0) -> list[AccountBlock]:
    """Return moving blocks with the sensors' noise and `factor` times 0.01 L/min beside it."""
    rng = np.random.default_rng((seed, 9))
    made = []
    for block in blocks_of_an_exact_model(count, seed):
        error = factor * 0.01 / 60000.0 * rng.standard_normal(2)
        made.append(replace(moving(block), missing=block.missing + error))
    return made
