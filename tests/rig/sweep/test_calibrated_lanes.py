"""The readings of lanes are corrected by the calibrations of the rig's transducers."""

from pathlib import Path

import numpy as np
import pytest

from rig.configuration.sweeps.sweep import load_sweep
from rig.lanes import LANES
from rig.sweep.drawing import draw
from rig.sweep.group import setting_of
from rig.sweep.run_cases import judge_cases

SWEEP = """\
name: corrected
rig: ./rig.yaml
filter: product
cases: 8
duration: 10 s
figures:
  level: {expression: mean(pressure_1_Pa), unit: Pa}
motions:
  - {type: sine, mean: 0.3 m, amplitude: 0.05 m, frequency: 0.5 Hz, phase: 0}
"""
ERRING = "effects: {pressure_1_bias: 0.2 MPa}\n"
CERTIFICATE = """\
channel: pressure_1_Pa
transducer: "1"
date: 2026-01-01
valid_until: 2099-01-01
points:
  - {reference: 0 MPa, indicated: 0.2 MPa}
  - {reference: 20 MPa, indicated: 20.2 MPa}
"""


def mean_pressure(folder: Path, rig: str, sweep: str) -> float:
    (folder / "certificate.yaml").write_text(CERTIFICATE)
    (folder / "rig.yaml").write_text(f"name: rig\nparent: ideal\n{rig}")
    (folder / "sweep.yaml").write_text(sweep)
    read = load_sweep(folder / "sweep.yaml")
    levels = judge_cases(setting_of(read), draw(read, 0, LANES))["figure_level"]
    return float(np.mean(levels.astype(np.float64)))


@pytest.mark.long
def test_a_calibration_undoes_the_error_that_it_found(tmp_path: Path) -> None:
    true = mean_pressure(tmp_path, "", SWEEP)
    erring = mean_pressure(tmp_path, "", SWEEP + ERRING)
    corrected = mean_pressure(tmp_path, "calibrations: [./certificate.yaml]\n", SWEEP + ERRING)
    assert erring - true == pytest.approx(0.2e6, rel=0.01)
    assert corrected - true == pytest.approx(0.0, abs=0.002e6)
