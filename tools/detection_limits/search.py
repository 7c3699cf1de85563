"""Searches motions for the one by which the smallest leak could be found in 30 s or in a minute.

`python -m tools.detection_limits.search` computes the bound of `bound.py`, with the budget of the
model's errors, for sines and triangles of several amplitudes and frequencies on the nominal,
unloaded rig, and prints a line for each as it comes, in L/min.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE, NOMINAL
from rig.plant.integrator import TICK
from tools.simulated.drawn_rigs import MIDDLE

from .bound import budgeted_noise, flow_bound
from .courses import follow
from .study import ONSET_S, POWER

Array = NDArray[np.float64]

WINDOWS_S: Final = (30.0, 60.0)
AMPLITUDES_M: Final = (0.01, 0.03, 0.1, 0.2)
FREQUENCIES_HZ: Final = (0.1, 0.25, 0.5, 1.0, 2.0)
FASTEST: Final = 0.4
"""Greatest speed of a motion, m/s: somewhat more than half of what the valve can do."""
FALSE_ALARMS_A_DAY: Final = 1.0


def motions(ticks: int) -> Iterator[tuple[str, Array]]:
    """Yield name and setpoints in m, float64 (ticks,), of each motion that is not too fast."""
    time_s = np.arange(ticks) * TICK
    for amplitude in AMPLITUDES_M:
        for frequency in FREQUENCIES_HZ:
            phase = frequency * time_s
            if 2.0 * np.pi * amplitude * frequency <= FASTEST:
                yield (
                    f"sine {amplitude} m, {frequency} Hz",
                    MIDDLE + amplitude * np.sin(2.0 * np.pi * phase),
                )
            if 4.0 * amplitude * frequency <= FASTEST and frequency <= 0.5:
                triangle = 1.0 - 4.0 * np.abs((phase + 0.75) % 1.0 - 0.5)
                yield f"triangle {amplitude} m, {frequency} Hz", MIDDLE + amplitude * triangle


def main() -> None:
    """Print the smallest leaks of each motion: out of chamber 1, out of chamber 2, across."""
    for name, setpoint in motions(round((ONSET_S + WINDOWS_S[-1]) / TICK) + 2):
        course = follow(name, NOMINAL, setpoint)
        try:
            bound = flow_bound(course, budgeted_noise(course), ONSET_S, WINDOWS_S)
        except ValueError as error:
            print(f"{name}: {error}", flush=True)
            continue
        smallest = bound.smallest(FALSE_ALARMS_A_DAY, POWER) / LITRE_PER_MINUTE
        said = (
            f"{window_s:g} s {' '.join(f'{size:.4f}' for size in sizes)}"
            for window_s, sizes in zip(WINDOWS_S, smallest.T, strict=True)
        )
        print(f"{name}: {'; '.join(said)}", flush=True)


if __name__ == "__main__":
    main()
