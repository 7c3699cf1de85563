"""Draws what is wrong with a rig; writes a file of what it is, and of what is believed of it."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from rig.configuration import Rig, load_rig

KINDS: Final = ("valve", "encoder", "spool", "pressures", "null", "noise", "stroke")
"""What may be wrong; the first four are keys of the section `wiring`."""
_NULL_M: Final = (3e-6, 11e-6)
"""Range of the null bias of the spool, m, of either sign; a run allows its upper end."""
_NOISIER: Final = (1.6, 4.0)
_NOISES: Final = {
    "pressure_noise": "Pa", "supply_pressure_noise": "Pa", "spool_noise": "m",
}  # fmt: skip
_STROKE_M: Final = (0.45, 0.59)
_AT_A_STOP: Final = 0.2
"""Chance that the ram rests at one of its stops at first."""


@dataclass(frozen=True)
class Drawn:
    """A rig that was built wrong.

    Attributes:
        seed: seed of the draw, and of the sensors' noise.
        wrong: what is wrong with it, of `KINDS`.
        null_m: null bias of the spool, m; None for that of the usual emulated rig.
        noise: key of the section `sensors` and its value, SI; None if none is wrong.
        stroke_max: end of the stroke, m; None for the usual one.
        start_m: where the ram rests at first, m.
    """

    seed: int
    wrong: tuple[str, ...]
    null_m: float | None
    noise: tuple[str, float] | None
    stroke_max: float | None
    start_m: float

    @property
    def wiring(self) -> dict[str, str]:
        """The section `wiring` of the rig as it is."""
        keys = [key for key in KINDS[:4] if key in self.wrong]
        return {key: "swapped" if key == "pressures" else "inverted" for key in keys}


def drawn(seed: int, number: int) -> Drawn:
    """Return the rig of a number, drawn from a seed: with one to three things wrong."""
    generator = np.random.default_rng([seed, number])
    wrong = tuple(generator.choice(KINDS, size=generator.integers(1, 4), replace=False).tolist())
    null = float(generator.uniform(*_NULL_M) * generator.choice([-1.0, 1.0]))
    key = str(generator.choice(list(_NOISES)))
    usual = _usual()
    noise = float(generator.uniform(*_NOISIER)) * getattr(usual.sensors, key)
    stroke = float(generator.uniform(*_STROKE_M))
    end = stroke if "stroke" in wrong else usual.plant.parameters.stroke_max
    start = float(generator.uniform(0.05, end - 0.05))
    if generator.random() < _AT_A_STOP:
        start = float(generator.choice([0.0, end]))
    return Drawn(
        seed=seed * 1000 + number,
        wrong=wrong,
        null_m=null if "null" in wrong else None,
        noise=(key, noise) if "noise" in wrong else None,
        stroke_max=stroke if "stroke" in wrong else None,
        start_m=start,
    )


def write_rigs(rig: Drawn, folder: Path, ports: tuple[int, int, int]) -> tuple[Path, Path]:
    """Write the rig file of what the rig is, and of what is believed of it; return both paths.

    Args:
        rig: the rig.
        folder: an existing folder.
        ports: free ports for I/O node, bypass valves and CAN.
    """
    shipped = yaml.safe_load(_shipped("emulated").read_text())
    drivers: dict[str, Any] = shipped["drivers"]
    daq, bypass, can = ports
    drivers["daq"]["port"], drivers["bypass"]["port"] = daq, bypass
    drivers["drive"]["port"] = drivers["pump"]["port"] = can
    drivers["meters"]["port"] = str(folder / "meters")
    # A shared machine may stop a process for a second, which is not what the trials are about.
    loop = {**shipped["loop"], "supervisor_silence": "5 s"}
    believed = {"name": "new rig", "parent": "emulated", "drivers": drivers, "loop": loop}
    truth: dict[str, Any] = {**believed, "name": "as it is"}
    usual = yaml.safe_load(_shipped("simulated").read_text())
    plant, sensors = usual["plant"], usual["sensors"]
    if rig.null_m is not None:
        plant["effects"]["spool_null_bias"] = f"{rig.null_m!r} m"
    if rig.stroke_max is not None:
        plant["parameters"]["stroke_max"] = f"{rig.stroke_max!r} m"
        truth["limits"] = {**usual["limits"], "position": ["5 mm", f"{rig.stroke_max - 0.01!r} m"]}
    if rig.noise is not None:
        key, value = rig.noise
        sensors[key] = f"{value!r} {_NOISES[key]}"
    truth |= {"plant": plant, "sensors": sensors}
    if rig.wiring:
        truth["wiring"] = rig.wiring
    paths = folder / "truth.yaml", folder / "rig.yaml"
    for path, content in zip(paths, (truth, believed), strict=True):
        path.write_text(yaml.safe_dump(content, sort_keys=False))
    return paths


@cache
def _usual() -> Rig:
    return load_rig("emulated")


def _shipped(name: str) -> Path:
    return Path(__file__).parents[2] / "config" / "rigs" / f"{name}.yaml"
