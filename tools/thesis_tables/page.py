"""Writes the whole page: runs every campaign once and fills the template."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from rig.plant.integrator import TICK

from .causes import REPEATS
from .chapters import loaded_tables, unloaded_table, validation_tables
from .leak_tables import innovation_change, residual_change
from .markdown import figure, fixed, table
from .measures import LEAST_DROP
from .printed import SECTION_7_1, SECTION_7_2, TABLE_5_1, TABLE_5_2, TABLE_5_3
from .score import score
from .trials import Trials, run_trials
from .validation import FILES, Measured
from .why import (
    friction_table,
    hidden_table,
    levels_table,
    noise_table,
    oil_table,
    runaway_figures,
    runaway_table,
)

_TEMPLATE: Final = "page.md.j2"


def page(measured: Measured | None) -> str:
    """Run all campaigns and return the page as Markdown.

    With `measured`, section 3.2 is compared with those recordings too.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(_TEMPLATE).render(_context(measured))


def _context(measured: Measured | None) -> dict[str, Any]:
    open_loop = run_trials("open_loop_5_1", "thesis-6")
    sine = run_trials("closed_loop_sine_5_2_1", "thesis-6")
    pseudorandom = run_trials("closed_loop_pseudorandom_5_2_2", "thesis-6")
    simulation = run_trials("simulation_7_1", "thesis-7")
    loaded = run_trials("loaded_7_2", "thesis-7")
    par = open_loop.campaign.model.parameters
    slip_speed = par.coulomb * TICK / par.moving_mass
    healthy = open_loop.healthy()
    return {
        "false_alarms": f"{open_loop.campaign.false_alarms_per_day:g}",
        "least_drop": f"{LEAST_DROP / 1e6:g}",
        "short": short_table([open_loop, sine, pseudorandom, simulation, loaded]),
        "residual": _both(residual_change(healthy, i).before for i in range(2)),
        "innovation": _both(innovation_change(healthy, i).before for i in range(2)),
        "validation": validation_tables(measured),
        "recordings": _recordings(measured),
        "origin": "" if measured is None else measured.origin,
        "table_5_1": unloaded_table(open_loop, TABLE_5_1),
        "table_5_2": unloaded_table(sine, TABLE_5_2),
        "table_5_3": unloaded_table(pseudorandom, TABLE_5_3, sine=False),
        "section_7_1": loaded_tables(simulation, SECTION_7_1),
        "section_7_2": loaded_tables(loaded, SECTION_7_2),
        "levels": levels_table(),
        "oil_column": oil_table(open_loop),
        "friction": friction_table([open_loop, sine], slip_speed),
        "slip_speed": f"{fixed(slip_speed, 2)} m/s",
        "repeats": str(REPEATS),
        "noise": noise_table([open_loop, sine]),
        "hidden": hidden_table([open_loop, sine]),
        "runaway": runaway_table(loaded),
        "run": runaway_figures(loaded),
    }


def short_table(trials: Sequence[Trials]) -> str:
    """Return a table with one row for each campaign: how often each detector was right."""
    head = ["campaign and thesis filter", "leaks", "pattern: right at the end",
            "pattern: fault before the leak", "pattern: alarm in healthy tests",
            "product: right at the end", "product: true flow in its interval",
            "product: alarm in healthy tests"]  # fmt: skip
    rows = []
    for campaign in trials:
        counts = score(campaign.trials)
        rows.append(
            [
                f"`{campaign.campaign.name}`, `{campaign.filter_name}`",
                str(counts.leaks),
                str(counts.pattern_right),
                str(counts.pattern_early),
                f"{counts.pattern_alarms} of {counts.healthy}",
                str(counts.product_right),
                f"{counts.covered} of {counts.product_right}",
                f"{counts.product_alarms} of {counts.healthy}",
            ]
        )
    return table(head, rows)


def _both(levels: Any) -> str:
    return " and ".join(figure(level / 1e6) for level in levels)


def _recordings(measured: Measured | None) -> str:
    if measured is None:
        return ""
    return ", ".join(
        f"`{FILES[motion]}` ({recording.content_hash()[:12]})"
        for motion, recording in measured.recordings.items()
    )
