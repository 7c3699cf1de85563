"""A Modbus client that nobody here wrote reads and writes the emulator (mbpoll of Debian)."""

import re
import shutil
import subprocess
from typing import Final

import pytest

from rig.emulator.running import EmulatorThread

_MBPOLL: Final = shutil.which("mbpoll")

pytestmark = pytest.mark.skipif(
    _MBPOLL is None, reason="mbpoll is not installed (apt install mbpoll)"
)


def mbpoll(emulator: EmulatorThread, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Poll once, addresses from 0, floats and integers with their high word first."""
    assert _MBPOLL is not None
    port = str(emulator.ports["daq"])
    return subprocess.run(
        [_MBPOLL, "-0", "-1", "-B", "-p", port, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )


def values(polled: subprocess.CompletedProcess[str]) -> dict[int, str]:
    found = re.findall(r"^\[(\d+)\]:\s+(\S+)", polled.stdout, re.MULTILINE)
    return {int(address): value for address, value in found}


def test_it_reads_what_the_device_is(emulator: EmulatorThread) -> None:
    polled = mbpoll(emulator, "-t", "4:hex", "-r", "512", "-c", "2", "127.0.0.1")
    assert values(polled) == {512: "0x5249", 513: "0x0001"}


def test_it_reads_pressures_in_kilopascal_as_either_kind_of_register(
    emulator: EmulatorThread,
) -> None:
    for kind in ("3", "4"):
        polled = mbpoll(emulator, "-t", f"{kind}:float", "-r", "268", "127.0.0.1")
        assert float(values(polled)[268]) == pytest.approx(13_800.0, rel=0.02)


def test_it_writes_and_reads_back(emulator: EmulatorThread) -> None:
    written = mbpoll(emulator, "-t", "4:float", "-r", "2", "127.0.0.1", "--", "1.5")
    assert "Written 1 references" in written.stdout
    assert values(mbpoll(emulator, "-t", "4:float", "-r", "2", "127.0.0.1")) == {2: "1.5"}


def test_it_tells_of_a_value_that_is_refused(emulator: EmulatorThread) -> None:
    refused = mbpoll(emulator, "-t", "4", "-r", "514", "127.0.0.1", "--", "0")
    assert refused.returncode != 0
    assert "Illegal data value" in refused.stderr
