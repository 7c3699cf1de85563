"""Another master on an owned I/O node moves nothing, and the rig trips with its name."""

import struct
from pathlib import Path

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
