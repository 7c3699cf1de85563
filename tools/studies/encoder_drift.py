"""Counts how drifts of the encoder and shifts of the null are named on rigs drawn at random.

`python -m tools.studies.encoder_drift --count 12` draws as many rigs of the product's simulation,
and as many of the independent one (`tools.hidden_effects`) with the tolerances of a healthy rig. On
each, an encoder drifts from 20 s on; on the former, the null shifts by 0.5 um in another trial,
whose flow is that of a drift of 2 mm/s. A trial lasts 60 s. The table is printed.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from control import POSITION_GAIN
from estimator.leaks import Decision, replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import DATA_SHEET, FAULT_COLUMNS, TICK, Model
from rig.recording import Recording
from tools.hidden_effects import motions
from tools.hidden_effects.recordings import COLUMNS, record
from tools.intermittent.trials import healthy_rig
from tools.pages.marked_tables import markdown
from tools.simulated.drawn_rigs import MIDDLE, drawn_motion, drawn_rig
from tools.simulated.recordings import SETTLE_TICKS, recorded

Array = NDArray[np.float64]
Change = Literal["drift", "null"]

SECONDS: Final = 60.0
ONSET_S: Final = 20.0
NULL_SHIFT: Final = 5e-7
"""Shift of the spool's null in m: its flow is that of a drift of 2 mm/s."""
WITHIN_S: Final = 30.0
_OTHER_MOTIONS: Final = ("multisine", "pseudorandom", "steps", "sines", "ramps")


@dataclass(frozen=True)
class Course:
    """What became of one trial.

    Attributes:
        named_s: time from the onset to the first verdict `encoder_drift`, s; None if there was
            none.
        first_s: time from the onset to the first decision that has the drift among its causes, s;
            None if there was none.
        leaks: half seconds with the verdict of a leak or of several faults, without the drift
            beside it, from the onset on.
        final: the last decision.
    """

    named_s: float | None
    first_s: float | None
    leaks: int
    final: Decision


def changes(kind: Change, size: float) -> tuple[Array, Array]:
    """Return what an encoder's reading and a null are off by in each tick, m; one of them is 0."""
    time_s = np.arange(round(SECONDS / TICK)) * TICK
    if kind == "drift":
        return size * np.maximum(time_s - ONSET_S, 0.0), np.zeros(time_s.size)
    return np.zeros(time_s.size), np.where(time_s >= ONSET_S, size, 0.0)


def drawn(seed: int, kind: Change, size: float) -> Recording:
    """Return the recording of a rig of the product's simulation.

    A loop whose reading is off by d asks for the setpoint less d of the ram itself. A null that is
    off opens the valve as a command would that nobody sent.
    """
    rng = np.random.default_rng([seed, 11])
    away, null = changes(kind, size)
    rig = drawn_rig(rng)
    setpoint, open_loop = drawn_motion(rng, away.size)
    unsent = null / rig.valve_gain
    asked = setpoint + unsent if open_loop else setpoint - away + unsent / POSITION_GAIN
    motion = Motion(
        asked, open_loop, np.zeros((away.size, len(FAULT_COLUMNS))), MIDDLE, SETTLE_TICKS
    )
    made = recorded(simulated_rig(Model(parameters=rig), seed), motion)
    return _read(made, away, null, rig.valve_gain)


def independent(seed: int, kind: Change, size: float) -> Recording:
    """Return the recording of an independent rig; as `drawn`."""
    rng = np.random.default_rng([seed, 12])
    away, null = changes(kind, size)
    rig = healthy_rig(rng, other_forms=seed % 4 >= 2)
    motion = motions.drawn(_OTHER_MOTIONS[int(rng.integers(len(_OTHER_MOTIONS)))], rng, away.size)
    asked = motions.Motion(
        motion.setpoint - away, motion.feed + null / rig.spool_per_volt, motion.gain
    )
    table = record(rig, asked, np.random.default_rng([seed, 13])).table
    made = Recording({name: table[:, i].copy() for i, name in enumerate(COLUMNS)})
    return _read(made, away, null, rig.spool_per_volt)


def _read(made: Recording, away: Array, null: Array, valve_gain: float) -> Recording:
    """Return a recording as the sensors have it; those of the spool count from its old null."""
    names = (*COLUMNS, "supply_pressure_Pa")
    channels = {str(name): made[name].copy() for name in names if name in made.channels}
    count = DATA_SHEET.position_resolution
    channels["position_m"] = np.round((channels["position_m"] + away) / count) * count
    channels["command_V"] -= null / valve_gain
    channels["spool_m"] -= null
    return Recording(channels)


def judged(recording: Recording) -> Course:
    """Return what the product's detector makes of a recording, with the nominal model."""
    history = [(at, held) for at, held in replay(recording, Model()).history if at >= ONSET_S]
    named = (at - ONSET_S for at, held in history if held.verdict == "encoder_drift")
    first = (at - ONSET_S for at, held in history if held.drift is not None)
    leaks = sum(held.names_a_fault and held.drift is None for _, held in history)
    return Course(next(named, None), next(first, None), leaks, history[-1][1])


def row(name: str, courses: Sequence[Course]) -> list[str]:
    """Return a row of the table: what the detector made of these trials."""
    named = [each.named_s for each in courses if each.named_s is not None]
    in_time = sum(time_s <= WITHIN_S for time_s in named)
    right = sum(each.final.verdict == "encoder_drift" for each in courses)
    middle = f"{np.median(named):.0f} / {max(named):.0f} s" if named else "–"
    others = sum(
        each.final.names_a_fault and each.final.verdict != "encoder_drift" for each in courses
    )
    silent = sum(each.final.verdict == "healthy" for each in courses)
    passing = sum(each.leaks > 0 for each in courses)
    counts = len(courses), in_time, right, middle, passing, others, silent
    return [name, *map(str, counts)]


def main(arguments: list[str] | None = None) -> None:
    """Run the trials and print the table; `arguments` are those of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.studies.encoder_drift", description=__doc__
    )
    parser.add_argument("--count", type=int, default=12, help="rigs of each kind; default 12")
    parser.add_argument("--rate", type=float, default=2e-3, help="of the drift, m/s; default 2e-3")
    parser.add_argument("--seed", type=int, default=0, help="number of the first rig; default 0")
    options = parser.parse_args(arguments)
    seeds = range(options.seed, options.seed + options.count)
    signs = [1.0 if seed % 2 else -1.0 for seed in seeds]
    drifts = list(zip(seeds, signs, strict=True))
    made = {
        f"drift of {1e3 * options.rate:g} mm/s, drawn rigs": [
            judged(drawn(seed, "drift", sign * options.rate)) for seed, sign in drifts
        ],
        f"drift of {1e3 * options.rate:g} mm/s, the other simulator's": [
            judged(independent(seed, "drift", sign * options.rate)) for seed, sign in drifts
        ],
        "null shifts by 0.5 µm, drawn rigs": [
            judged(drawn(seed, "null", sign * NULL_SHIFT)) for seed, sign in drifts
        ],
    }
    head = ["what changes", "trials", "named within 30 s", "named at the end",
            "named after, median / longest", "another fault in between",
            "another fault at the end", "healthy at the end"]  # fmt: skip
    print(markdown(head, [row(name, courses) for name, courses in made.items()]))


if __name__ == "__main__":
    main()
