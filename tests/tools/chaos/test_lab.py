"""The lab of a station tells by the station's own log who has the rig, and how a lease ended."""

import json
from pathlib import Path

import pytest
import yaml

from tools.chaos.idle_station import told
from tools.chaos.lab import Lab
from tools.chaos.stage import Stage

FOUND = ("found", "the rig is read; found valve disabled")


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump({"name": "emulated"}))
    return Lab(Stage(tmp_path))


def keep(lab: Lab, *lines: tuple[str, str]) -> None:
    path = lab.stage.folder / "runs" / "station-emulated" / "station.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps({"kind": k, "text": t}) + "\n" for k, t in lines))


def lent(pid: int) -> tuple[str, str]:
    return ("lent", f"homing, asked by Bo, drives (process {pid})")


def test_who_never_got_the_rig_has_no_lease(lab: Lab) -> None:
    assert lab.lease_of(7) == []
    keep(lab, FOUND, lent(71), ("returned", "homing, asked by Bo, has ended"), FOUND)
    assert lab.lease_of(7) == []
    assert lab.is_idle()


@pytest.mark.parametrize("end", ["returned", "died", "left"])
def test_a_lease_ends_by_the_first_line_that_ends_one(lab: Lab, end: str) -> None:
    keep(lab, FOUND, lent(7))
    assert (lab.driver(), lab.lease_of(7), lab.is_idle()) == (7, ["lent"], False)
    keep(lab, FOUND, lent(7), (end, "homing"), FOUND, lent(8), ("died", "homing"))
    assert (lab.driver(), lab.lease_of(7), lab.lease_of(8)) == (
        None,
        ["lent", end],
        ["lent", "died"],
    )


def test_what_grows_is_reckoned_to_the_hours_asked_for_and_a_leak_is_said() -> None:
    times_s = [10.0 * i for i in range(400)]
    flat = {("loop", "descriptors"): (times_s, [40.0] * 400)}
    (line,), leaks = told(flat, 8.0)
    assert not leaks
    assert "+0.0000 per hour" in line
    grows = {("loop", "memory"): (times_s, [100.0 + t / 36.0 for t in times_s])}
    (line,), leaks = told(grows, 8.0)
    assert leaks
    assert "at most +800.00 in 8 h: a LEAK" in line
