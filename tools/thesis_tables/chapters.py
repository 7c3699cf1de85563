"""Writes the thesis's own tables with printed and computed figures, and counts over them."""

from collections.abc import Sequence
from typing import Final

from .leak_tables import Column, columns_of, innovation_change, leak_table, trusted_change
from .markdown import NOTHING, figure, table
from .measures import rise
from .printed import PrintedTable
from .score import score
from .trials import Trials
from .validation import (
    FIGURES,
    PRINTED,
    Measured,
    Simulated,
    compare,
    compare_without_drift,
    one_step_error,
    run_simulated,
)

EXTERNAL: Final = ("external_leakage_1", "external_leakage_2")
INTERNAL: Final = "internal_leakage"
KINDS: Final = (*EXTERNAL, INTERNAL)


def validation_tables(measured: Measured | None) -> dict[str, str]:
    """Return section 3.2's tables by motion; with `measured`, they have columns for recordings.

    Each table has the printed figures on what was recorded less what the model simulates, beside
    those for the simulated rig.
    """
    simulated = run_simulated()
    return {motion: _validation_table(motion, simulated, measured) for motion in PRINTED}


def _validation_table(motion: str, simulated: Simulated, measured: Measured | None) -> str:
    model, recording = simulated.model, simulated.recordings[motion]
    columns = {
        "simulated rig": compare(recording, model),
        "simulated rig, drift out": compare_without_drift(recording, model),
        "simulated rig, its own model": compare(recording, simulated.truth),
    }
    steps = [one_step_error(recording, model)] * 2 + [one_step_error(recording, simulated.truth)]
    if measured is not None:
        recording = measured.recordings[motion]
        columns["recording"] = compare(recording, model)
        columns["recording, drift out"] = compare_without_drift(recording, model)
        steps += [one_step_error(recording, model)] * 2
    printed = PRINTED[motion]
    rows = [
        [name, printed.get(name, NOTHING), *(figure(take(c) / unit) for c in columns.values())]
        for name, unit, take in FIGURES
    ]
    for i in (1, 2):
        cells = [figure(step[i] / 1e5) for step in steps]
        rows.append([f"pressure {i}, one sample ahead (1e5 Pa)", NOTHING, *cells])
    return table(["recorded less simulated", "printed", *columns], rows)


def unloaded_table(trials: Trials, printed: PrintedTable, *, sine: bool = True) -> dict[str, str]:
    """Return a table of chapter 5 (`table`), and a sentence with counts over it (`counts`).

    `sine` chooses the tests with a sine as setpoint, or else those with another one.
    """
    columns = columns_of(trials, printed, KINDS, sine=sine)
    return {"table": leak_table(columns, 6), "counts": counted(columns)}


def loaded_tables(trials: Trials, printed: PrintedTable) -> dict[str, str]:
    """Return a section's tables of chapter 7 by kind of leak, and under `counts` counts over all.

    The counts are a sentence (`counted`).
    """
    columns = {kind: columns_of(trials, printed, (kind,)) for kind in KINDS}
    tables = {kind: leak_table(of_kind, 5) for kind, of_kind in columns.items()}
    return tables | {"counts": counted([c for of_kind in columns.values() for c in of_kind])}


def counted(columns: Sequence[Column]) -> str:
    """Return a text that counts rises of the averages and right verdicts over the leaks' columns.

    Counted are the rises of the innovations' moving averages that section 5.3 expects, and the
    right verdicts of the thesis's pattern and of the product's detector.
    """
    counts = score([column.trial for column in columns])
    return (
        f"By the innovation, {_pattern(columns, trusted=False)}; with the encoder trusted, "
        f"{_pattern(columns, trusted=True)}. Of {counts.leaks} leaks the thesis's pattern names "
        f"{counts.pattern_right} rightly at the end, and it held a fault before the leak in "
        f"{counts.pattern_early}; the product's detector names {counts.product_right}, with the "
        f"true flow within its interval in {counts.covered}."
    )


def _pattern(columns: Sequence[Column], *, trusted: bool) -> str:
    """Return a text that counts how often the innovations' averages rise as in section 5.3."""
    of = trusted_change if trusted else innovation_change
    external, internal = [], []
    for column in columns:
        if column.trial.leak is None:
            continue
        rises = [rise(of(column.trial, chamber)) for chamber in range(2)]
        if column.kind == INTERNAL:
            internal.append(min(rises) > 0.0)
        else:
            leaking = EXTERNAL.index(str(column.kind))
            external.append(rises[leaking] > rises[1 - leaking])
    return (
        f"the leaking chamber's average rises more than the other's in {sum(external)} of "
        f"{len(external)} external leaks, and both rise in {sum(internal)} of {len(internal)} "
        "internal ones"
    )
