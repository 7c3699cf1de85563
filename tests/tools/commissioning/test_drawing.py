"""What is drawn wrong with a rig stands in the file of what it is, and not in what is believed."""

from pathlib import Path

import pytest

from rig.configuration import load_rig
from rig.io.wiring import Wiring
from tools.commissioning.drawing import KINDS, drawn, write_rigs
from tools.commissioning.trial import trial


def test_ten_rigs_have_one_to_three_things_wrong_each_and_all_kinds_come_up() -> None:
    rigs = [drawn(1, number) for number in range(10)]
    assert {len(rig.wrong) for rig in rigs} <= {1, 2, 3}
    assert {kind for rig in rigs for kind in rig.wrong} == set(KINDS)
    assert rigs == [drawn(1, number) for number in range(10)]


def test_both_files_are_usable_and_differ_by_what_is_wrong(tmp_path: Path) -> None:
    rig = next(
        each for number in range(99) if {"valve", "stroke"} <= set((each := drawn(3, number)).wrong)
    )
    truth, believed = map(load_rig, write_rigs(rig, tmp_path, (5001, 5002, 5003)))
    assert believed.wiring == Wiring()
    assert truth.wiring.valve == "inverted"
    assert truth.plant.parameters.stroke_max == rig.stroke_max
    assert truth.drivers == believed.drivers


@pytest.mark.long
def test_an_emulated_rig_that_is_built_wrong_is_found_out(tmp_path: Path) -> None:
    judged = trial(drawn(1, 7), tmp_path, ("--skip", "friction", "--skip", "baseline"))
    assert not judged.missed
    assert not judged.trips
    assert judged.code == 0
