"""Times the tracking law in the compiled tick, beside the proportional loop, in one run.

`python -m tools.bench.control` calls each law a million times in one compiled function, in turn
with the other, for several rounds. It prints the median time of a call in ns of the thread's
processor time, what the law adds, and its ratio to the proportional loop.
"""

import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.changing import Moment, Steered, change_memory, is_changing, offset_of_change
from control.loop_model import MOST_TONES
from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from control.tracking import PLAIN, ControlLaw, control_memory, tracking_command
from rig.jit import njit
from rig.plant.integrator import TICK

CALLS: Final = 1_000_000
ROUNDS: Final = 7
FULL: Final = ControlLaw(False, 0.05, 0.3, 0.3, 50.0, 1.0, 5e-4, 3.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _calls(setpoint, position, ahead, expected, law, tones, memory):
    total = 0.0
    for k in range(setpoint.size):
        total += tracking_command(
            setpoint[k], position[k], ahead[k], expected[k], k * TICK, POSITION_GAIN, COMMAND_LIMIT,
            TICK, law, tones, memory,
        )  # fmt: skip
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def _changeable_calls(setpoint, position, ahead, expected, law, tones, memory, change, offset):
    """Call the law as the loops do, which look for a change; `offset` is set anew for each call."""
    total = 0.0
    for k in range(setpoint.size):
        change.state[1] = offset
        now, time_s = ahead[k], k * TICK
        if is_changing(change):
            steered = Steered(POSITION_GAIN, law, now, tones)
            now += offset_of_change(
                Moment(setpoint[k], position[k], time_s, COMMAND_LIMIT, TICK), steered, steered,
                memory, change,
            )  # fmt: skip
        total += tracking_command(
            setpoint[k], position[k], now, expected[k], time_s, POSITION_GAIN, COMMAND_LIMIT, TICK,
            law, tones, memory,
        )  # fmt: skip
    return total


def _tones(count: int) -> NDArray[np.float64]:
    """Return the numbers of `count` tones."""
    return np.tile((np.pi, 1e-5, 1e-6, 0.02), (count, 1)).astype(np.float64)


def measured() -> dict[str, float]:
    """Return the median time of a call in s, by the name of the law."""
    angle = np.pi * TICK * np.arange(CALLS)
    setpoint = 0.3 + 0.15 * np.sin(angle)
    position, ahead, expected = setpoint - 1e-3, 7.0 * np.cos(angle), setpoint - 5e-4
    laws = {
        "proportional": (PLAIN.law, PLAIN.tones, None),
        "tracking": (FULL, PLAIN.tones, None),
        "tracking, looking for a change": (FULL, PLAIN.tones, 0.0),
        "tracking, a change that fades": (FULL, PLAIN.tones, 1.0),
        "tracking, sine": (FULL, _tones(3), None),
        f"tracking, {MOST_TONES} frequencies": (FULL, _tones(MOST_TONES), None),
    }
    times: dict[str, list[float]] = {name: [] for name in laws}
    for round_number in range(ROUNDS + 1):
        for name, (law, tones, offset) in laws.items():
            memory, change = control_memory(), change_memory()
            begun = time.thread_time()
            if offset is None:
                _calls(setpoint, position, ahead, expected, law, tones, memory)
            else:
                _changeable_calls(
                    setpoint, position, ahead, expected, law, tones, memory, change, offset
                )
            # The first round compiles.
            if round_number:
                times[name].append((time.thread_time() - begun) / CALLS)
    return {name: float(np.median(each)) for name, each in times.items()}


def main() -> None:
    """Print the times of all laws."""
    found = measured()
    plain = found["proportional"]
    print("| law | ns a call | added, ns | ratio |\n|---|--:|--:|--:|")
    for name, each in found.items():
        print(f"| {name} | {1e9 * each:.1f} | {1e9 * (each - plain):.1f} | {each / plain:.1f} |")


if __name__ == "__main__":
    main()
