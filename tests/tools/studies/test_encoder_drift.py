"""The study of encoders that drift counts what the detector makes of them."""

import numpy as np
import pytest

from estimator.leaks import Decision
from tools.studies.encoder_drift import ONSET_S, SECONDS, Course, changes, row


def test_a_drift_grows_from_its_onset_on_and_a_null_shifts_at_once() -> None:
    away, null = changes("drift", -2e-3)
    assert away[-1] == pytest.approx(-2e-3 * (SECONDS - ONSET_S), abs=1e-5)
    assert not null.any()
    away, null = changes("null", 5e-7)
    assert not away.any()
    assert np.unique(null).tolist() == [0.0, 5e-7]


def test_its_table_counts_names_and_times() -> None:
    courses = [
        Course(12.0, 8.0, 0, Decision("encoder_drift")),
        Course(34.0, 9.0, 3, Decision("encoder_drift")),
        Course(None, None, 0, Decision("healthy")),
        Course(None, None, 40, Decision("internal_leakage")),
    ]
    assert row("drift", courses) == ["drift", "4", "1", "2", "23 / 34 s", "2", "1", "1"]
