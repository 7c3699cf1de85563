"""`rig doctor` shows what a machine grants, with the remedy for what it does not."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.hardware.doctor import Finding, machine
from rig.configuration import load_rig
from rig.loop.clock import wakeup_lateness
from rig.supervisor.leases.keeper import Keeper
from rig.surviving import Surviving

pytestmark = pytest.mark.usefixtures("no_memory_locked")

Invoke = Callable[..., Any]

BENCH = """
name: bench
parent: simulated
backend: hardware
supply_pressure_sensor: false
load_cell: false
spool_sensor: false
loop: {cpu: 1023}
drivers:
  daq:
    driver: plain_fast
    host: daq
    inputs: [position_m, pressure_1_Pa, pressure_2_Pa]
    outputs: [command_V]
  bypass: {driver: plain_slow, host: nowhere}
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A machine's /proc, /sys and /dev, made for rigs."""
    return tmp_path / "root"


def reported(root: Path, subject: str, files: dict[str, str]) -> Finding:
    """Return what is found of a subject on a machine with these files."""
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(f"{text}\n")
    found = {finding.subject: finding for finding in machine(root.parent, root)}
    return found[subject]


CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"
CPU = "sys/devices/system/cpu"


@pytest.mark.parametrize(
    ("subject", "files", "grade", "words"),
    [
        ("kernel", {"sys/kernel/realtime": "1"}, "good", "PREEMPT_RT"),
        ("clock source", {CLOCK: "tsc"}, "good", "tsc"),
        ("clock source", {CLOCK: "hpet"}, "weak", "boot with tsc=reliable"),
        (
            "frequency governor",
            {f"{CPU}/cpu0/cpufreq/scaling_governor": "performance"},
            "good",
            "performance",
        ),
        (
            "frequency governor",
            {
                f"{CPU}/cpu0/cpufreq/scaling_governor": "performance",
                f"{CPU}/cpu1/cpufreq/scaling_governor": "powersave",
            },
            "weak",
            "cpupower frequency-set --governor performance",
        ),
        ("real-time throttling", {"proc/sys/kernel/sched_rt_runtime_us": "-1"}, "good", "off"),
        ("serial ports", {"dev/ttyUSB0": ""}, "good", "ttyUSB0"),
        (
            "CAN interfaces",
            {"sys/class/net/can0/type": "280", "sys/class/net/can0/operstate": "up"},
            "good",
            "can0 up",
        ),
        (
            "CAN interfaces",
            {"sys/class/net/can0/type": "280", "sys/class/net/can0/operstate": "down"},
            "weak",
            "ip link set can0 up type can",
        ),
        ("CAN interfaces", {"sys/class/net/eth0/type": "1"}, "good", "none"),
    ],
)
def test_a_machine_is_described_by_what_its_kernel_says(
    root: Path, subject: str, files: dict[str, str], grade: str, words: str
) -> None:
    finding = reported(root, subject, files)
    assert finding.grade == grade
    assert words in finding.found + finding.remedy
    assert bool(finding.remedy) == (grade != "good")


def test_a_disk_that_takes_no_recordings_is_bad() -> None:
    found = {finding.subject: finding for finding in machine(Path("/proc"))}
    for subject in ("disk space", "disk speed"):
        assert found[subject].grade == "bad"
        assert "--out" in found[subject].remedy


@pytest.mark.usefixtures("plain_drivers")
def test_the_drivers_of_a_rig_are_opened_and_what_is_refused_is_reported(
    tmp_path: Path, invoke: Invoke
) -> None:
    (tmp_path / "bench.yaml").write_text(BENCH)
    done = invoke("doctor", "--rig", str(tmp_path / "bench.yaml"), "--seconds", "0.02", "--json")
    reported = json.loads(done.out)
    found = {finding["subject"]: finding for finding in reported["findings"]}
    assert done.code == 1
    assert found["driver daq"]["grade"] == "good"
    assert found["driver bypass"]["found"] == "host: nobody answers"
    assert found["driver bypass"]["remedy"] == "plug it in"
    assert found["processor 1023"]["grade"] == "weak"
    assert "loop: cpu" in found["processor 1023"]["remedy"]
    assert reported["loop"]["ticks"] == 20


@pytest.mark.usefixtures("plain_drivers")
@pytest.mark.parametrize(
    ("state", "grade", "bypass"), [("idle", "good", "good"), ("no devices", "weak", "bad")]
)
def test_a_station_is_told_of_and_its_devices_are_left_alone(
    tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch, state: str, grade: str,
    bypass: str,
) -> None:  # fmt: skip
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    file = tmp_path / "bench.yaml"
    file.write_text(BENCH)
    with Keeper(load_rig(str(file)), Surviving("the socket", print)) as keeper:
        keeper.stands(state, "what it does")
        done = invoke("doctor", "--rig", str(file), "--seconds", "0.02", "--json")
    found = {finding["subject"]: finding for finding in json.loads(done.out)["findings"]}
    assert found["station"]["grade"] == grade
    assert "what it does" in found["station"]["found"]
    assert found["driver bypass"]["grade"] == bypass


def test_without_a_rig_the_table_ends_with_the_loop(invoke: Invoke) -> None:
    done = invoke("doctor", "--seconds", "0.02")
    assert "SCHED_FIFO 80" in done.out
    assert "20 ticks at 1000 Hz" in done.out.splitlines()[-2]


def test_a_rig_that_cannot_be_read_is_bad_input(invoke: Invoke) -> None:
    done = invoke("doctor", "--rig", "nowhere")
    assert (done.code, done.out) == (2, "")
    assert "nowhere is not a known rig" in done.err


def test_every_tick_of_the_idle_loop_woke_late_or_was_missed() -> None:
    lateness = wakeup_lateness(1e-3, 20)
    assert lateness.shape == (20,)
    assert np.nanmin(lateness) >= 0.0


def test_ticks_that_are_past_are_skipped_without_a_burst() -> None:
    # No system call returns within 50 ns: each wakes after its successors.
    lateness = wakeup_lateness(5e-8, 1000)
    assert np.isnan(lateness).any()
    assert np.isfinite(lateness[0])
