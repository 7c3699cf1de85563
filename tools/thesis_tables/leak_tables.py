"""Writes a table of leaks: one column for each test, with printed and computed figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks.detection import SETTLED_AFTER_S, Decision, leak_flow
from faults.leakage import to_litres_per_minute

from .causes import POSITION
from .markdown import NOTHING, arrow, fixed, heading_row, spread, table
from .measures import (
    Change,
    average_change,
    change,
    meter_flow,
    metered_coefficient,
    share_outside,
    true_flow,
)
from .printed import Printed, PrintedTable
from .trials import Trial, Trials

Array = NDArray[np.float64]

LOCATIONS: Final = {
    "external_leakage_1": "chamber 1",
    "external_leakage_2": "chamber 2",
    "internal_leakage": "internal",
}
LEVELS: Final = {2: ("low", "high"), 3: ("low", "medium", "high")}


@dataclass(frozen=True)
class Column:
    """One column of a table: a test with the figures that the thesis prints of it.

    Attributes:
        heading: location and level of the leak, or "healthy".
        trial: the test as it was run.
        printed: the figures that the thesis prints.
        kind: the kind of leak whose meter is read. For a healthy test it is the table's only kind,
            or None if the table has several.
    """

    heading: str
    trial: Trial
    printed: Printed
    kind: str | None


def columns_of(
    trials: Trials, printed: PrintedTable, kinds: Sequence[str], *, sine: bool = True
) -> list[Column]:
    """Return the columns of the healthy test and of the tests with the given kinds of leak.

    The healthy test comes first, then the kinds in their order, each with the smallest leak first.
    `sine` chooses the tests with a sine as setpoint, or else those with another one.
    """
    only = kinds[0] if len(kinds) == 1 else None
    healthy = printed.get("healthy", (Printed(),))[0]
    columns = [Column("healthy", trials.healthy(sine=sine), healthy, only)]
    for kind in kinds:
        leaks = trials.leaks(kind, sine=sine)
        for level, trial, figures in zip(LEVELS[len(leaks)], leaks, printed[kind], strict=True):
            columns.append(Column(f"{LOCATIONS[kind]}, {level}", trial, figures, kind))
    return columns


Row = tuple[str, Callable[[Column], str]]


def leak_table(columns: Sequence[Column], exponent: int) -> str:
    """Return the table of some tests in Markdown, with moving averages in units of 10^exponent Pa.

    Rows in which no test has a figure are left out.
    """
    sections = [
        ("Leak", _leak_rows(columns)),
        *((f"MAE of chamber {i + 1} (1e{exponent} Pa)", _chamber_rows(i, 10.0**exponent))
          for i in range(2)),
        ("Leak states of the product's filter (L/min)", _STATE_ROWS),
        ("Verdict", _VERDICT_ROWS),
    ]  # fmt: skip
    width = len(columns) + 1
    rows = []
    for name, section in sections:
        cells = [[label, *(cell(column) for column in columns)] for label, cell in section]
        # Rows without any figure are left out, such as figures that the thesis does not print.
        filled = [row for row in cells if set(row[1:]) != {NOTHING}]
        rows += [heading_row(name, width), *filled]
    return table(["", *(column.heading for column in columns)], rows)


def _leak_rows(columns: Sequence[Column]) -> list[Row]:
    linear = any(c.trial.leak.linear for c in columns if c.trial.leak)
    unit, name = (1e-12, "1e-12 m³/(s Pa)") if linear else (1e-9, "1e-9 m³/(s √Pa)")
    return [
        (f"coefficient, printed ({name})", lambda c: spread(c.printed.coefficient, unit)),
        ("coefficient, asked", lambda c: fixed(c.trial.leak.coefficient / unit, 2)
         if c.trial.leak else NOTHING),
        ("coefficient, by the meter", lambda c: spread(metered_coefficient(c.trial), unit)),
        *([] if linear else [
            ("coefficient, product's detector", lambda c: _found_coefficient(c.trial, unit)),
        ]),
        ("flow, printed (L/min)", lambda c: arrow(c.printed.flow, decimals=2)),
        ("flow, by the meter", lambda c: arrow(meter_flow(c.trial, c.kind), decimals=2)
         if c.kind else NOTHING),
        ("flow, truth", lambda c: fixed(true_flow(c.trial), 3)),
    ]  # fmt: skip


def _chamber_rows(i: int, unit: float) -> list[Row]:
    return [
        ("printed", lambda c: arrow(c.printed.averages[i], unit, decimals=2)),
        ("innovation", lambda c: arrow(innovation_change(c.trial, i), unit)),
        ("a posteriori", lambda c: arrow(residual_change(c.trial, i), unit)),
        ("innovation, encoder trusted", lambda c: arrow(trusted_change(c.trial, i), unit)),
        ("innovation, product's filter", lambda c: arrow(product_change(c.trial, i), unit)),
    ]


def innovation_change(trial: Trial, chamber: int) -> Change:
    """Return the averaged absolute innovation of a chamber's pressure in the thesis's filter, Pa.

    The values before and after the leak are those of `average_change`. `chamber` is 0 for chamber 1
    and 1 for chamber 2.
    """
    return _average(trial.thesis.run.innovation[:, 1 + chamber], trial)


def residual_change(trial: Trial, chamber: int) -> Change:
    """Return the averaged absolute a posteriori residual of a chamber's pressure, Pa.

    It is that of the thesis's filter; for the rest see `innovation_change`.
    """
    return _average(trial.thesis.run.residual[:, 1 + chamber], trial)


def trusted_change(trial: Trial, chamber: int) -> Change:
    """Return `innovation_change` for the thesis filter that trusts the encoder (`trusted`), Pa."""
    return _average(trial.trusted.outputs[:, 1 + chamber], trial)


def product_change(trial: Trial, chamber: int) -> Change:
    """Return `innovation_change` for the product filter, Pa."""
    return _average(trial.product.run.innovation[:, 1 + chamber], trial)


def state_change(trial: Trial, kind: str) -> Change:
    """Return the mean flow (L/min) of the product filter's state for a kind of leak.

    The means before and after the leak are those of `change`; each begins 2 s after the filter's
    start or the leak's opening. A flow across the piston counts as positive from the higher to the
    lower pressure.
    """
    run = trial.product.run
    flow = to_litres_per_minute(leak_flow(run, trial.model.parameters)[kind])
    if kind == "internal_leakage":
        flow = flow * np.sign(run.state("pressure_1_Pa") - run.state("pressure_2_Pa"))
    return change(flow, trial.recording.time_s, trial.leak, SETTLED_AFTER_S)


def _average(error: Array, trial: Trial) -> Change:
    return average_change(error, trial.recording.time_s, trial.leak)


def outside_change(trial: Trial) -> Change:
    """Return the share of samples (%) at which the thesis filter's position is outside the stroke.

    See `share_outside`, which counts the samples before and after the leak.
    """
    return share_outside(trial.thesis.run.states[:, POSITION], trial)


def said(decision: Decision | None, trial: Trial) -> str:
    """Return a verdict in words, in bold if it is what the test expects; a dash for None."""
    if decision is None:
        return NOTHING
    word = LOCATIONS.get(decision.verdict, decision.verdict.replace("_", " "))
    return f"**{word}**" if decision.verdict == trial.test.expect else word


def _found_flow(trial: Trial) -> str:
    decision = trial.product.decision
    if decision.leak_m3_per_s is None or decision.leak_std_m3_per_s is None:
        return NOTHING
    flow = to_litres_per_minute(decision.leak_m3_per_s)
    half = to_litres_per_minute(1.96 * decision.leak_std_m3_per_s)
    return f"{fixed(flow, 3)} ± {fixed(half, 3)}"


def _found_coefficient(trial: Trial, unit: float) -> str:
    found = trial.product.decision.coefficient
    return NOTHING if found is None else fixed(found / unit, 2)


def _state_row(kind: str) -> Row:
    return LOCATIONS[kind], lambda c: arrow(state_change(c.trial, kind), decimals=2)


_STATE_ROWS: Final = [_state_row(kind) for kind in LOCATIONS]

_VERDICT_ROWS: Final[list[Row]] = [
    ("position estimate outside the stroke (% of time)",
     lambda c: arrow(outside_change(c.trial), decimals=0)),
    ("thesis's pattern before the leak", lambda c: _word(c.trial.pattern_before_leak)),
    ("thesis's pattern at the end", lambda c: said(c.trial.thesis.decision, c.trial)),
    ("product's detector at the end", lambda c: said(c.trial.product.decision, c.trial)),
    ("flow it finds, ± 95 % (L/min)", lambda c: _found_flow(c.trial)),
]  # fmt: skip


def _word(decision: Decision | None) -> str:
    if decision is None:
        return NOTHING
    return LOCATIONS.get(decision.verdict, decision.verdict.replace("_", " "))
