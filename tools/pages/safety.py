"""Writes the tables of docs/safety.md that follow from the code.

Run as `python -m tools.pages.safety`. The text between the tables is written by hand.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from rig.configuration.reading.quantities import show
from rig.io.settings import HomingSettings, LoopSettings
from rig.io.signals import FAST_INPUTS
from rig.loop.interlocks.check_tolerances import frozen_samples, sigmas, tolerances
from rig.loop.interlocks.ladder import EXPLANATIONS, Cause
from rig.plant.integrator import TICK
from rig.plant.parameters import NOMINAL
from rig.plant.sensors import DATA_SHEET
from rig.supervisor.states import TRANSITIONS, VALVE_ENABLED, State, Transition
from tools.chaos.drawn.bounds import TABLE

PAGE: Final = Path(__file__).parents[2] / "docs" / "safety.md"

_TABLE: Final = re.compile(r"(<!-- table of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def main() -> None:
    """Write the tables in `TABLES` anew in docs/safety.md; its other tables and text stay."""
    PAGE.write_text(updated(PAGE.read_text()))


def updated(page: str) -> str:
    """Return the text of `page`, in which every table in `TABLES` is written anew; others stay."""

    def table(match: re.Match[str]) -> str:
        lines = TABLES.get(match[2])
        return match[0] if lines is None else match[1] + "\n".join(lines()) + "\n" + match[3]

    return _TABLE.sub(table, page)


def transitions_table() -> Iterator[str]:
    """Yield the lines of the state machine's table in Markdown.

    Transitions that differ in nothing but the state that they begin in share a line. A star marks
    the states in which the valve is enabled.
    """
    yield "| state | event | goes to | if |"
    yield "|---|---|---|---|"
    rows: dict[Transition, list[State]] = {}
    for row in TRANSITIONS:
        rows.setdefault(row._replace(state=State.OFF), []).append(row.state)
    for row, states in rows.items():
        names = ", ".join(f"{state.value}{_mark(state)}" for state in states)
        guards = ", ".join(guard.name for guard in row.guards)
        yield f"| {names} | {row.event.value} | {row.to.value}{_mark(row.to)} | {guards} |"


def _mark(state: State) -> str:
    return "\\*" if state in VALVE_ENABLED else ""


def causes_table() -> Iterator[str]:
    """Yield the lines of the table of all causes of a trip in Markdown, one line for each cause."""
    yield "| number | cause | the operator reads | remedy |"
    yield "|---|---|---|---|"
    for cause, (sentence, remedy) in EXPLANATIONS.items():
        if cause is not Cause.NONE:
            text = sentence.format(channel="*channel*")
            yield f"| {cause.value} | `{cause.name}` | {text} | {remedy} |"


def thresholds_table() -> Iterator[str]:
    """Yield the lines of the table of plausibility thresholds, for shipped data sheets at 1 kHz."""
    tol = tolerances(
        NOMINAL, DATA_SHEET, frozenset(FAST_INPUTS), TICK, LoopSettings.stale_limit,
        HomingSettings(),
    )  # fmt: skip
    values = {
        "standard deviations of noise": f"{sigmas(TICK):.2f}",
        "equal samples in a row": f"{frozen_samples(TICK)}",
        "speed of the encoder": f"{tol.jump_speed_m_per_s:.2f} m/s",
        "spool opening that may be unknown": show(tol.null_m, "m"),
        "part of the flow that may be unknown": f"{tol.flow_fraction:.0%}",
        "travel that the flow leaves unexplained": show(tol.flow_account_m, "m"),
        "work against the motion": f"{tol.work_J:.1f} J",
        "chamber above supply": f"{show(tol.above_supply_Pa, 'Pa')} for "
        f"{tol.above_supply_ticks} ms",
        "spool off the nominal valve": f"{show(tol.spool_m, 'm')} + {tol.spool_fraction:.0%} + "
        f"{1e3 * tol.spool_lag_s:g} ms of lag, for {tol.spool_ticks} ms",
        "valve output off the command": f"{show(tol.command_V, 'V')} for {tol.confirm_ticks} ms",
        "age of a sample": f"{tol.stale_ticks} ms",
        "command before homing": show(tol.unhomed_command_V, "V"),
        "load pressure before homing": show(tol.unhomed_load_pressure_Pa, "Pa"),
    }
    yield "| threshold | value |"
    yield "|---|---|"
    yield from (f"| {name} | {value} |" for name, value in values.items())


def promises_table() -> Iterator[str]:
    """Yield the lines of the table of what drawn cases of chaos must keep, in Markdown."""
    yield "| what | within | which is |"
    yield "|---|---|---|"
    yield from (f"| {name} | {each.ms:g} ms | {each.why} |" for name, each in TABLE.items())


TABLES: Final[Mapping[str, Callable[[], Iterator[str]]]] = {
    "transitions": transitions_table,
    "causes": causes_table,
    "thresholds": thresholds_table,
    "promises": promises_table,
}
"""The functions that write the tables, by the name in the table's comment on the page."""


if __name__ == "__main__":
    main()
