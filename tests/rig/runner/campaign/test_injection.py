from math import inf

import numpy as np
import pytest

from faults.schedule import Fault
from rig.runner.campaign.injection import LEAK_CHANNELS, Injection

CHANNELS = ("time_s", *(truth for truth, _ in LEAK_CHANNELS.values()))


def rows(from_s: float, to_s: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Rows at 1 kHz in which chamber 1 leaks 1, chamber 2 the time, and the piston -3."""
    time_s = np.round(np.arange(from_s, to_s, 1e-3), 6)
    return np.column_stack([time_s, np.ones_like(time_s), time_s, np.full_like(time_s, -3.0)])


def test_the_mean_flow_is_absolute_and_counts_from_two_seconds_after_the_onset() -> None:
    faults = (
        Fault("external_leakage_2", 1e-9, at_s=1.0),
        Fault("internal_leakage", 1e-9, at_s=1.5),
    )
    injection = Injection(faults, CHANNELS)
    for start in (0.0, 2.0, 4.0):
        injection.take(rows(start, start + 2.0))
    chamber_2, internal = injection.injected
    assert chamber_2.mean_flow_m3_per_s == pytest.approx(4.5, abs=1e-3)
    assert internal.mean_flow_m3_per_s == 3.0


def test_the_mean_flow_of_a_leak_that_ends_is_that_while_it_lasted() -> None:
    injection = Injection((Fault("external_leakage_2", 1e-9, at_s=1.0, until_s=4.0),), CHANNELS)
    injection.take(rows(0.0, 8.0))
    assert injection.injected[0].mean_flow_m3_per_s == pytest.approx(3.5, abs=1e-3)


METERED = ("time_s", *(meter for _, meter in LEAK_CHANNELS.values()))


def test_what_a_meter_read_before_its_bypass_was_opened_is_no_leak() -> None:
    zero, leak = 8e-7, 1e-5
    time_s = np.arange(0.0, 10.0, 1e-3)
    flow = zero + np.where(time_s >= 4.0, leak, 0.0)
    metered = np.column_stack([time_s, flow, np.full_like(time_s, zero), np.full_like(time_s, 1.0)])
    faults = (
        Fault("external_leakage_1", 1e-9, at_s=4.0),
        Fault("external_leakage_2", 1e-9, at_s=4.0),
        Fault("internal_leakage", 1e-9, at_s=0.5),
    )
    injection = Injection(faults, METERED)
    for part in np.array_split(metered, 7):
        injection.take(part)
    found = {fault.kind: fault.mean_flow_m3_per_s for fault in injection.injected}
    assert found["external_leakage_1"] == pytest.approx(leak)
    # A meter that shows no more than its zero shows that nothing came.
    assert found["external_leakage_2"] == pytest.approx(0.0, abs=1e-15)
    # Open almost from the beginning: what its meter reads of nothing is not known.
    assert found["internal_leakage"] == 1.0


def test_a_true_flow_has_no_zero() -> None:
    injection = Injection((Fault("external_leakage_1", 1e-9, at_s=4.0),), CHANNELS)
    injection.take(rows(0.0, 10.0))
    assert injection.injected[0].mean_flow_m3_per_s == pytest.approx(1.0)


def test_a_fault_that_had_not_begun_was_not_injected() -> None:
    injection = Injection((Fault("external_leakage_1", 1e-9, at_s=5.0),), CHANNELS)
    injection.take(rows(0.0, 4.0))
    assert not injection.injected
    injection.take(rows(4.0, 6.0))
    (fault,) = injection.injected
    assert fault.at_s == 5.0
    assert fault.mean_flow_m3_per_s is None  # not yet two seconds old


def test_a_supply_leak_has_no_recorded_flow() -> None:
    injection = Injection((Fault("supply_leakage", 1e-9),), CHANNELS)
    injection.take(rows(0.0, 4.0))
    assert injection.injected[0].mean_flow_m3_per_s is None


def test_events_come_once_each_in_the_order_of_their_times() -> None:
    faults = (
        Fault("external_leakage_1", 1e-9, at_s=0.0, until_s=3.0),
        Fault("internal_leakage", 1e-9, at_s=1.0, until_s=inf),
    )
    injection = Injection(faults, CHANNELS)
    happened = [e for start in range(5) for e in injection.take(rows(start, start + 1.0))]
    assert [(time, kind) for time, kind, _ in happened] == [
        (0.0, "fault_on"),
        (1.0, "fault_on"),
        (3.0, "fault_off"),
    ]
    assert injection.injected[0].until_s == 3.0
    assert injection.injected[1].until_s is None
