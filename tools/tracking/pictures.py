"""Draws the picture of docs/tracking.md: a sine under the thesis's loop and the tracking law."""

from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from control import ControlSettings
from rig.configuration import load_rig
from tools.simulated.tracking_guide import TRACKING

from .runs import SINE, run

SECONDS: Final = 8.0
_LAWS: Final = (
    ("gain alone, as in the thesis", "tab:orange", ControlSettings()),
    ("tracking law", "tab:green", TRACKING),
)


def sine_picture(file: Path) -> dict[str, float]:
    """Draw a sine under both laws on the simulated rig; return the rms errors in m, by law.

    The same figure always gives the same file.
    """
    rig = load_rig("simulated")
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    found: dict[str, float] = {}
    for name, colour, control in _LAWS:
        moved = run(rig, SINE, SECONDS, control)
        if not found:
            above.plot(moved.time_s, 1e3 * moved.setpoint, color="0.6", lw=4.0, label="setpoint")
        found[name] = moved.rms()
        label = f"{name}: {1e3 * found[name]:.2g} mm rms"
        above.plot(moved.time_s, 1e3 * moved.position, color=colour, lw=1.5, label=name)
        below.plot(moved.time_s, 1e3 * moved.error(), color=colour, lw=1.5, label=label)
    above.set_ylabel("position, mm")
    below.set_ylabel("error, mm")
    below.set_xlabel("time, s")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(loc="upper right", fontsize=8, ncols=3)
    above.set_ylim(top=530.0)
    below.set_ylim(-115.0, 175.0)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110, metadata={"Software": None})
    return found
