"""Commissions one emulated rig, watches over it meanwhile, and judges what was found."""

import json
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rig.configuration import load_rig
from rig.io import Wiring

from .drawing import Drawn, write_rigs

NULL_V: Final = 0.02
"""Greatest error of the null that was found, V: 1.3 mm/s of drift in open loop."""
NOISE_PART: Final = 0.15
STROKE_M: Final = 1e-3
FASTEST: Final = 0.06
"""Mean speed from look to look beyond which a ram is too fast, m/s. The operator is told 50 mm/s;
the valve makes 650 at 10 V. A ram that breaks away is faster, for less than a millimetre."""
_PERIOD_S: Final = 0.05


@dataclass
class Judged:
    """What came of one rig.

    Attributes:
        rig: the rig.
        code: exit code of the command.
        missed: what was wrong and not found, or was found and not so, in words.
        trips: trips of the session or of the device's watchdog, in words.
        speed: greatest mean speed of the ram from one look to the next, m/s.
        pressure: greatest pressure of a chamber, Pa.
        seconds: duration of the command, s.
        said: the end of what the command printed, if it did not end with 0.
    """

    rig: Drawn
    code: int = -1
    missed: list[str] = field(default_factory=list)
    trips: list[str] = field(default_factory=list)
    speed: float = 0.0
    pressure: float = 0.0
    seconds: float = 0.0
    said: str = ""

    @property
    def good(self) -> bool:
        """Whether all was found, nothing tripped and the ram was never in danger."""
        return not (self.code or self.missed or self.trips) and self.speed < FASTEST


def trial(rig: Drawn, folder: Path, options: tuple[str, ...]) -> Judged:
    """Commission a rig in an existing folder, with further options of the command; judge it."""
    truth, believed = write_rigs(rig, folder, _free_ports())
    before = believed.read_text()
    judged = Judged(rig)
    emulator = subprocess.Popen(
        [
            sys.executable, "-m", "rig.cli", "emulate", str(truth), "--json", "--control", "0",
            "--seed", str(rig.seed), "--start", f"{rig.start_m!r} m",
        ],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert emulator.stdout is not None
    try:
        ready = json.loads(emulator.stdout.readline())
        begun = time.monotonic()
        command = subprocess.Popen(
            [
                sys.executable, "-m", "rig.cli", "commission", str(believed), "--yes", "--json",
                "--folder", str(folder / "out"), *options,
            ],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        _watch(command, int(ready["ports"]["control"]), judged)
        said = command.communicate()[0]
        judged.code, judged.seconds = command.returncode, time.monotonic() - begun
    finally:
        emulator.terminate()
        ended = emulator.communicate()[0]
    judged.said = said[-600:] if judged.code else ""
    events = json.loads(ended.splitlines()[-1])
    if events.get("watchdog_trip"):
        judged.trips.append("the device's watchdog")
    judged.trips += [str(path.name) for path in (folder / "out").rglob("trip*")]
    if judged.code == 0:
        judged.missed = list(_missed(rig, truth, believed))
    elif believed.read_text() != before:
        judged.missed.append("the rig file was changed although the command did not finish")
    return judged


def _watch(command: "subprocess.Popen[str]", port: int, judged: Judged) -> None:
    """Note the greatest speed and pressure of the true plant until the command has ended."""
    with socket.create_connection(("127.0.0.1", port)) as line, line.makefile("rw") as control:
        last: tuple[float, float] | None = None
        while command.poll() is None:
            control.write(json.dumps({"do": "status"}) + "\n")
            control.flush()
            status: dict[str, Any] = json.loads(control.readline())
            plant, at_s = status["plant"], 1e-9 * status["time_ns"]
            if last is not None and at_s > last[0]:
                speed = abs(plant["position"] - last[1]) / (at_s - last[0])
                judged.speed = max(judged.speed, speed)
            last = at_s, plant["position"]
            pressures = plant["pressure_1"], plant["pressure_2"]
            judged.pressure = max(judged.pressure, *pressures)
            time.sleep(_PERIOD_S)


def _missed(rig: Drawn, truth: Path, believed: Path) -> list[str]:
    """Return what of a rig was missed, or found wrongly, in words."""
    true, found, usual = load_rig(truth), load_rig(believed), load_rig("emulated")
    missed = []
    if found.wiring != Wiring(**rig.wiring):  # type: ignore[arg-type]
        missed.append(f"wiring: {found.wiring}")
    par = true.plant.parameters
    null = -par.spool_null_bias / par.valve_gain
    if abs(found.control.null - null) > NULL_V:
        missed.append(f"null: {found.control.null:.3f} V, true {null:.3f} V")
    for key, value in true.sensors._asdict().items():
        told = getattr(found.sensors, key)
        changed = value != getattr(usual.sensors, key)
        if abs(told - value) > (NOISE_PART * value if changed else 0.0):
            missed.append(f"{key}: {told:.3g}, true {value:.3g}")
    if abs(found.plant.parameters.stroke_max - par.stroke_max) > STROKE_M:
        told = found.plant.parameters.stroke_max
        missed.append(f"stroke: {told:.4f} m, true {par.stroke_max:.4f} m")
    if found.limits.position_max_m > par.stroke_max:
        missed.append("the upper limit lies beyond the stroke")
    return missed


def _free_ports() -> tuple[int, int, int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(3)]
    try:
        one, two, three = (each.getsockname()[1] for each in sockets)
        return one, two, three
    finally:
        for each in sockets:
            each.close()
