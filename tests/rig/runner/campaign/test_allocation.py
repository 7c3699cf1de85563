"""The loop allocates nothing in a tick, whatever it does about a fault."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.runtime.nrt import rtsys

from estimator.filters.registry import start_memory
from faults.campaign import CampaignTest, OnFault
from rig.configuration.rigs.rig import Rig
from rig.loop.decided import DECIDED, Decided
from rig.plant import Model
from rig.runner.campaign.simulated_bench import loop_of


@pytest.fixture
def allocations() -> Iterator[Callable[[], int]]:
    """Count what compiled code has allocated."""
    _nrt_python.memsys_enable_stats()
    yield lambda: int(rtsys.get_allocation_stats().alloc)
    _nrt_python.memsys_disable_stats()


@pytest.mark.parametrize("on_fault", [OnFault.IGNORE, OnFault.TOLERATE, OnFault.HOLD])
def test_a_hundred_times_the_ticks_allocate_no_more(
    on_fault: OnFault,
    rig: Rig,
    leaking: Callable[..., CampaignTest],
    allocations: Callable[[], int],
) -> None:
    test = leaking(on_fault=on_fault)
    loop = loop_of(rig, test, start_memory("product", Model(), rig.sensors), Model())
    confirmed = np.zeros(len(DECIDED))
    confirmed[Decided.CONFIRMED], confirmed[Decided.PRESENT] = 1.0, 5e-9
    loop.decided(confirmed)
    loop.advance(10)
    counted = []
    for ticks in (10, 1000):
        before = allocations()
        loop.advance(ticks)
        counted.append(allocations() - before)
    assert counted[0] == counted[1]
