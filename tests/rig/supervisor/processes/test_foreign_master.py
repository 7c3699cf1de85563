"""Another master on an owned I/O node moves nothing, and the rig trips with its name."""

import struct
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient

from rig.loop.board import Word
from rig.loop.interlocks.ladder import Cause
from rig.supervisor.processes.driven import Driven
from tests.rig.supervisor.processes.test_loop_process import connected
from tests.waiting import until


def test_another_master_trips_the_rig_by_name_and_is_not_obeyed(tmp_path: Path) -> None:
    with connected(tmp_path) as rig:
        rig.open()
        rig.arm()
        words = rig.board.words
        assert words[Word.LOOP_TRIP] == 0
        with ModbusTcpClient("127.0.0.1", port=int(rig.emulator.ports["daq"])) as other:
            command = struct.unpack(">4H", struct.pack(">HHf", 1, 1, 9.0))
            assert other.write_registers(0, list(command)).exception_code == 6
        until(lambda: bool(words[Word.VALVE_NULL_AT]), "null was confirmed")
        assert words[Word.LOOP_TRIP] == Cause.FOREIGN_MASTER
        assert rig.is_null
        # It was refused: nothing was driven, of which there would be news.
        assert not [news for news in rig.news if isinstance(news, Driven)]


@pytest.mark.long
def test_a_rig_whose_node_another_master_owns_trips_and_is_nulled_by_a_request_that_needs_no_key(
    tmp_path: Path,
) -> None:
    with connected(tmp_path) as rig:
        rig.open()
        rig.arm()
        words = rig.board.words
        # As if the node had been switched off and on, and claimed by somebody else meanwhile.
        assert rig.emulator._emulator is not None
        node: Any = rig.emulator._emulator.node
        node._owner._key ^= 0x0F0F
        until(lambda: bool(words[Word.LOOP_TRIP]), "the trip")
        assert words[Word.LOOP_TRIP] == Cause.FOREIGN_MASTER
        until(lambda: rig.emulator.status()["daq"]["null_requested"], "null was latched")
        assert rig.is_null
