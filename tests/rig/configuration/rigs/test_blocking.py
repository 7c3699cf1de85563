"""Blocking valves in rig files."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from rig.configuration.rigs.rig import load_rig
from rig.supervisor.moves import preparing_moves

VALVES = "blocking_valves: {leak: 1e-4 L/min, leak_pressure: 10 MPa}\n"


def test_a_rig_whose_driver_moves_them_can_have_them_on_hardware() -> None:
    assert load_rig("emulated_locked").blocking_valves == load_rig("locked").blocking_valves


def test_without_such_a_driver_they_are_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(f"name: mine\nparent: emulated\n{VALVES}")
    with pytest.raises(
        ConfigError, match=r"rig.yaml:3.*none of the rig's drivers.*`blocking: true`"
    ):
        load_rig(path)


def test_they_are_open_before_anything_moves() -> None:
    wanted = preparing_moves(load_rig("emulated_locked"), ())
    assert wanted["blocking_1"] == wanted["blocking_2"] == 0.0
    assert "blocking_1" not in preparing_moves(load_rig("emulated"), ())
