"""The convergence table compares what it says it compares."""

import numpy as np

from rig.plant import NOMINAL
from rig.plant.dynamics import STATE_COUNT
from tools.studies.convergence import FINENESS, differences, motions, table


def test_a_horizons_differences_shrink_with_the_step() -> None:
    command, _ = motions(1.0)["reversing at speed, 8 V at 2 Hz"]
    found = np.array(list(differences(NOMINAL, command)))
    assert found.shape[1:] == (len(FINENESS), STATE_COUNT)
    pressure = np.median(found[:, :, 2], axis=0)
    assert (pressure[1:] < 0.2 * pressure[:-1]).all()


def test_the_table_has_each_motion_and_each_step_for_both_laws() -> None:
    shown = table(0.3)
    assert shown.row_count == 2 * (len(motions(0.3)) + len(FINENESS))
