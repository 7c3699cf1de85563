"""Turns hours of the independent rig into oil accounts, and keeps them in files.

The simulator takes steps of 0.1 ms here instead of 20 us, which is five times as fast; its fastest
mode, the piston on its stop (2.4e3 rad/s), is still resolved.
"""

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts.flow import AccountBlock, FlowAccount
from estimator.filters.registry import run_filter
from estimator.leaks.leak_statistic import LeakTest
from rig.plant import Model
from tools.alarm_rates.rigs import drawn_rig, mixed_motion
from tools.hidden_effects import physics
from tools.hidden_effects.recordings import PRESSURE_NOISE, SPOOL_NOISE, at_rest

Array = NDArray[np.float64]

PIECE_S: Final = 600.0
"""Length of a recording, s."""
PIECES: Final = 6
"""Recordings of each rig: the first half is one baseline, the second half another."""
_STEPS: Final = 10
_SETTLING: Final = 1000
_NULL_EVERY: Final = 10
"""The spool's null is taken anew from the accounts once in this many blocks."""


@dataclass(frozen=True)
class Piece:
    """A recording of a healthy rig as accounts.

    Attributes:
        blocks: its accounts in order.
        kinds: kind of motion of each block.
    """

    blocks: list[AccountBlock]
    kinds: list[str]


def simulated_piece(seed: int, number: int, piece_s: float = PIECE_S) -> Piece:
    """Return recording `number` of the rig of a seed, as accounts.

    The rig, and the model that is assumed (the nominal one), stay the same for all numbers.
    """
    rig = drawn_rig(np.random.default_rng([seed, 0]))
    rng = np.random.default_rng([seed, 1, number])
    rows = round(piece_s / physics.TICK)
    motion, names, starts = mixed_motion(rng, rows)
    held = np.full(_SETTLING, motion.setpoint[0])
    setpoint = np.concatenate([held, motion.setpoint])
    noise = rng.normal(size=(setpoint.size, 3)) * (PRESSURE_NOISE, PRESSURE_NOISE, SPOOL_NOISE)
    start = at_rest(rig, min(max(float(motion.setpoint[0]), 1e-3), 0.605))
    readings, _ = physics.run(
        rig, setpoint, np.zeros(setpoint.size), np.full(setpoint.size, motion.gain), 0, _SETTLING,
        noise, rng.random(setpoint.size), start, _STEPS,
    )  # fmt: skip
    command, position, p1, p2, spool = readings[_SETTLING:].T
    time_s = np.asarray(np.arange(rows) * physics.TICK, dtype=np.float64)
    measured = np.column_stack([position, p1, p2, spool, np.full(rows, np.nan)])
    commands = np.array(command, dtype=np.float64)
    run = run_filter(time_s, commands, measured, Model())
    names_of = ("spool_m", "pressure_1_Pa", "pressure_2_Pa", "position_m")
    estimates = [run.state(name) for name in names_of]
    departures = spool - estimates[0]
    unread = np.full(rows, np.nan)
    table = np.array([run.time_s, *estimates, np.ones(rows), unread, departures])
    blocks = _accounts(table)
    ends = [round(block.end_s / physics.TICK) - 1 for block in blocks]
    kinds = [names[int(np.searchsorted(starts, end, "right")) - 1] for end in ends]
    return Piece(blocks, kinds)


def _accounts(table: Array) -> list[AccountBlock]:
    account, test = FlowAccount(Model().parameters), LeakTest(100.0)
    null, first = test.null_bias(), 0
    found: list[AccountBlock] = []
    while first < table.shape[1]:
        end = first + account.samples_left
        for block in account.add(np.ascontiguousarray(table[:, first:end]), null):
            test.add(block)
            found.append(block)
            if len(found) % _NULL_EVERY == 0:
                null = test.null_bias()
        first = end
    return found


def pieces(seed: int, folder: Path, count: int = PIECES, piece_s: float = PIECE_S) -> list[Piece]:
    """Return the recordings of a rig, each from its file if it is there; else make and keep it."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number in range(count):
        file = folder / f"rig-{seed}-{number}-{piece_s:g}.pickle"
        if not file.exists():
            part = file.with_suffix(".part")
            part.write_bytes(pickle.dumps(simulated_piece(seed, number, piece_s)))
            part.replace(file)
        found.append(pickle.loads(file.read_bytes()))
    return found
