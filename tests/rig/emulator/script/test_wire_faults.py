from pathlib import Path
from typing import Any

import pytest

from rig.configuration import ConfigError
from rig.configuration.rigs.rig import Rig
from rig.emulator.addresses import HOST, Address, Endpoints
from rig.emulator.application import Emulator
from rig.emulator.record import Record
from rig.emulator.script.fault_script import ATTENTIVE, Script, fault_from, read_script
from rig.emulator.script.injection import NotServedError
from rig.emulator.script.wire_faults import KINDS

NEEDED = {
    "sensor": {"target": "pressure_1_Pa"},
    "stuck_bypass": {"target": "internal_leakage"},
    "stuck_blocking": {"target": "blocking_1"},
}
ON_BLOCKING = {"stuck_blocking"}
ON_CAN = {"can_silence", "can_garbage", "stuck_can", "pump_watchdog_dead", "drive_fault"}
ON_SERIAL = {"meter_unplugged", "meter_noise"}


def script(folder: Path, text: str) -> Path:
    path = folder / "script.yaml"
    path.write_text(text)
    return path


def test_a_script_gives_each_fault_its_times_in_seconds(tmp_path: Path) -> None:
    path = script(
        tmp_path,
        "faults:\n"
        "  - {fault: delay, target: daq, by: 5 ms, after: enable, at: 2 s, for: 500 ms}\n"
        "  - {fault: estop, at: 1 min}\n",
    )
    delay, estop = read_script(path).faults
    assert (delay.at_s, delay.after, delay.for_s) == (2.0, "enable", 0.5)
    assert delay.options.by == pytest.approx(5e-3)
    assert (estop.at_s, estop.after, estop.for_s) == (60.0, "start", float("inf"))


@pytest.mark.parametrize(
    ("told", "attentive"),
    [("", False), ("operator: away\n", False), ("operator: attentive\n", True)],
)
def test_somebody_presses_buttons_only_if_the_script_says_so(
    tmp_path: Path, told: str, attentive: bool
) -> None:
    assert read_script(script(tmp_path, told + "faults: []\n")).attentive == attentive


def test_the_script_of_an_emulator_that_is_given_none_says_that_somebody_does() -> None:
    assert read_script(ATTENTIVE) == Script((), attentive=True)
    assert Script() == Script((), attentive=False)


def test_all_mistakes_of_a_script_are_reported_at_once_with_line_and_remedy(tmp_path: Path) -> None:
    path = script(
        tmp_path,
        "fautls: []\n"
        "faults:\n"
        "  - {fault: dely}\n"
        "  - {fault: sensor, reads: hig}\n"
        "  - {fault: delay, by: 10 m, at: -1 s}\n"
        "  - {fault: exception, code: 99}\n",
    )
    with pytest.raises(ConfigError) as refused:
        read_script(path)
    told = [(problem.line, str(problem)) for problem in refused.value.problems]
    assert [line for line, _ in told] == [1, 3, 4, 4, 5, 5, 6]
    text = str(refused.value)
    for remedy in ("did you mean delay?", "did you mean high?", "add `target: ...`"):
        assert remedy in text


@pytest.mark.parametrize("text", ["{}", "faults: 3", "- {fault: delay}"])
def test_a_file_without_a_list_of_faults_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError):
        read_script(script(tmp_path, text))


def test_a_fault_asked_for_in_plain_values_is_checked_as_in_a_script() -> None:
    assert fault_from({"fault": "delay", "by": "3 ms", "for": "1 s"}).options.by == 3e-3
    with pytest.raises(ConfigError, match="did you mean delay"):
        fault_from({"fault": "delays"})


def served(rig: Rig, tmp_path: Path, clock: Any) -> Emulator:
    endpoints = Endpoints(Address(HOST, 0), meters=tmp_path / "meters")
    return Emulator(rig, endpoints, Record(clock=clock), clock=clock)


@pytest.mark.parametrize("kind", sorted(KINDS.keys() - ON_CAN - ON_BLOCKING))
def test_every_fault_begins_and_ends(simulated: Rig, tmp_path: Path, clock: Any, kind: str) -> None:
    emulator = served(simulated, tmp_path, clock)
    emulator.injection.inject(fault_from({"fault": kind, "for": "10 ms", **NEEDED.get(kind, {})}))
    clock.advance(5e-3)
    emulator.tend()
    assert [fault["fault"] for fault in emulator.status()["faults"]] == [kind]
    clock.advance(5e-3)
    emulator.tend()
    assert emulator.status()["faults"] == []
    events = [event["event"] for event in emulator.record.events]
    assert events.index("fault_begins") < events.index("fault_ends")
    emulator.injection.clear()
    (tmp_path / "meters").unlink(missing_ok=True)


@pytest.mark.parametrize("kind", sorted(ON_CAN | ON_SERIAL | ON_BLOCKING))
def test_a_fault_of_a_device_that_the_rig_has_not_is_refused(
    simulated: Rig, clock: Any, kind: str
) -> None:
    emulator = Emulator(simulated, Endpoints(Address(HOST, 0)), Record(clock=clock), clock=clock)
    with pytest.raises(NotServedError, match="leave the fault out"):
        emulator.injection.inject(fault_from({"fault": kind, **NEEDED.get(kind, {})}))
    assert emulator.status()["faults"] == []
