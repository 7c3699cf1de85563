"""A second master drives a rig that tripped: it is brought back, and that is reported.

These rigs do without ownership; an I/O node that is owned refuses what others write.
"""

import json
import struct
from collections.abc import Iterator
from math import nan
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient

from rig.configuration.rigs.rig import load_rig
from rig.io.can.ds408 import DriveState
from rig.loop.board import Word
from rig.loop.interlocks.ladder import Cause
from rig.loop.interlocks.trip import TripError
from rig.supervisor.processes.driven import Driven, Tally, departures
from rig.supervisor.trip_report import EventLog, TripReport, write_trip_report
from tests.rig.supervisor.processes.test_loop_process import Rig, connected
from tests.waiting import until

ENABLE, LAMP = 1, 4


class Master:
    """Another program with a connection to the I/O device."""

    def __init__(self, port: int) -> None:
        self._client = ModbusTcpClient("127.0.0.1", port=port, timeout=20.0)
        assert self._client.connect()
        self._counter = 0

    def drive(self, command_V: float, bits: int = ENABLE) -> None:  # noqa: N803
        self._counter += 1
        words = struct.unpack(">4H", struct.pack(">HHf", self._counter, bits, command_V))
        self._client.write_registers(0, list(words))

    def close(self) -> None:
        self._client.close()


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A rig that goes on being held at null after its trip."""
    with connected(tmp_path_factory.mktemp("driven")) as rig:
        rig.open(ownership="none")
        rig.arm()
        rig.board.words[Word.FIELD_TRIP] = Cause.BYPASS_STUCK
        until(lambda: bool(rig.board.words[Word.VALVE_NULL_AT]), "null was confirmed")
        yield rig


@pytest.fixture
def master(rig: Rig) -> Iterator[Master]:
    master = Master(int(rig.emulator.ports["daq"]))
    yield master
    master.close()


def driven(rig: Rig) -> list[Driven]:
    return [news for news in rig.news if isinstance(news, Driven)]


def test_a_valve_that_another_master_enables_after_a_trip_is_nulled_again_and_reported(
    rig: Rig, master: Master
) -> None:
    def found() -> bool:
        master.drive(5.0)
        return bool(driven(rig))

    until(found, "the other master was found")
    until(lambda: rig.emulator.status()["daq"]["latched"], "the device latched its null")
    assert rig.is_null
    told = driven(rig)[0]
    assert (told.who, told.part) == ("loop", "valve")
    assert told.text == "enabled, output at 5.00 V"
    assert told.first_ns > rig.board.words[Word.VALVE_NULL_AT]
    # It has latched: however the other master goes on, nothing moves any more.
    for _ in range(100):
        master.drive(5.0)
        assert rig.is_null


def test_a_lost_connection_is_rescued_by_another_one_which_goes_on_to_null_the_valve(
    tmp_path: Path,
) -> None:
    with connected(tmp_path) as rig:
        rig.open(ownership="none")
        rig.arm()
        rig.emulator.inject(**{"fault": "disconnect", "for": "10 ms"})
        until(lambda: bool(rig.news), "the loss was reported")
        assert rig.board.words[Word.LOOP_TRIP] == Cause.EXCHANGE_LOST
        assert "by another one" in rig.news[0].text
        # It says at once that it cannot be armed any more, and is not waited for in vain.
        with pytest.raises(TripError, match="start another"):
            rig.arm()
        until(lambda: rig.emulator.status()["daq"]["null_requested"], "null was latched")
        master = Master(int(rig.emulator.ports["daq"]))

        def found() -> bool:
            # The attentive operator of this rig answers whoever lights his lamp.
            master.drive(5.0, ENABLE | LAMP)
            return bool(driven(rig))

        until(found, "the other master was found")
        master.drive(0.0, 0)
        until(lambda: rig.is_null, "it is at null again")
        master.close()
        assert driven(rig)[0].part == "valve"
        assert driven(rig)[0].text.startswith("has ")


class Told:
    """Keeps what a tally tells, under a clock of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 0
        clock = SimpleNamespace(monotonic_ns=lambda: self.now_ns)
        monkeypatch.setattr("rig.supervisor.processes.driven.time", clock)
        self.news: list[Driven] = []
        self.tally = Tally("field", self.news.append)

    def go_on(self, seconds: float, part: str = "pump") -> None:
        """Find a part driven every 10 ms, for so long."""
        for _ in range(round(seconds / 0.01)):
            self.now_ns += 10_000_000
            self.tally.found(part, "loaded")


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    return Told(monkeypatch)


def test_a_master_that_goes_on_is_reported_at_once_and_then_once_a_second(told: Told) -> None:
    told.go_on(3.5)
    assert [news.times for news in told.news] == [1, 101, 201, 301]
    assert told.news[-1].sentence == "pump driven by another master: loaded, 301 times"
    told.tally.report_rest()
    assert told.news[-1].times == 350
    assert (told.news[-1].first_ns, told.news[-1].last_ns) == (10_000_000, 3_500_000_000)
    told.tally.report_rest()
    assert len(told.news) == 5


def test_each_part_is_reported_for_itself(told: Told) -> None:
    told.go_on(0.01)
    told.go_on(0.01, "valve drive")
    assert [news.sentence for news in told.news] == [
        "pump driven by another master: loaded, once",
        "valve drive driven by another master: loaded, once",
    ]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({"internal_leakage_ball": 0.0, "pump_loaded": 0.0}, {}),
        ({"drive_state": float(DriveState.DISABLED)}, {}),
        ({"internal_leakage_ball": 1.0}, {"internal leakage bypass": "open"}),
        ({"supply_leakage_ball": 0.5}, {"supply leakage bypass": "not shut"}),
        # A needle behind a shut ball lets nothing through.
        ({"internal_leakage_needle": 1.0}, {}),
        ({"return_blockage_needle": 0.5}, {"return throttle": "at 50 % of its way"}),
        ({"pump_loaded": 1.0, "pump_pressure_Pa": 1e7}, {"pump": "loaded"}),
        ({"drive_state": float(DriveState.ACTIVE)}, {"valve drive": "ACTIVE"}),
        ({"drive_state": nan, "pump_loaded": nan, "internal_leakage_ball": nan}, {}),
    ],
)  # fmt: skip
def test_what_departs_from_the_safe_state_is_named(
    values: dict[str, float], found: dict[str, str]
) -> None:
    assert departures(values) == found


def test_what_comes_after_the_report_was_written_is_added_and_kept_in_the_journal(
    tmp_path: Path,
) -> None:
    kept: list[str] = []
    said: list[str] = []
    event_log = EventLog(load_rig("emulated"), tmp_path, said.append, kept.append)
    trips = {"loop": (Cause.LIMIT_HIGH, 1_000_000)}
    event_log.report = TripReport(trips, {}, (), (), np.empty((0, 0)))
    event_log._reported = write_trip_report(event_log.report, tmp_path)
    found = Driven(3_000_000, "loop", "enabled", "valve", 2, 2_000_000, 3_000_000)
    event_log.take(found)
    event_log.complete_report()
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert [told["part"] for told in report["driven_by_another_master"]] == ["valve"]
    assert report["notes"][0]["what"] == found.sentence
    assert kept == [found.sentence]
    assert said == [f"loop: {found.sentence}"]
    assert not (tmp_path / "trip-2.json").exists()
