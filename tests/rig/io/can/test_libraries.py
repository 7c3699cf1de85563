"""What a process on a CAN bus imports besides: no tables, which take longer than all the rest."""

import subprocess
import sys
from pathlib import Path

RIG = Path(__file__).parents[4] / "config" / "rigs" / "emulated.yaml"
PROGRAM = f"""
import sys
from pathlib import Path
from rig.configuration.checking import check
check(Path({str(RIG)!r}))
import rig.emulator.can.devices, rig.io.can.pump, rig.io.can.valve
print(*sys.modules)
"""


def test_a_process_on_a_can_bus_loads_no_tables() -> None:
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    loaded = set(found.stdout.split())
    assert {"can", "cantools"} <= loaded
    assert loaded.isdisjoint({"asammdf", "pandas"})
