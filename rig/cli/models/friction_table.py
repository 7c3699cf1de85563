"""The table of `rig identify friction`."""

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from estimator.friction import PARAMETERS
from rig.report.friction import FrictionRun, in_words, shown


def friction_table(runs: Sequence[FrictionRun], *, plain: bool) -> Table:
    """Return a table of recordings and their friction; `plain` draws it with ASCII."""
    table = Table(box=box.ASCII2 if plain else box.ROUNDED)
    table.add_column("recording", overflow="fold")
    table.add_column("date")
    units = runs[0].curve.estimates
    for name in PARAMETERS:
        table.add_column(f"{in_words(name)}, {units[name].unit}", justify="right")
    table.add_column("speeds, mm/s", justify="right")
    for run in runs:
        curve = run.curve
        speeds = "none"
        if curve.slowest is not None and curve.fastest is not None:
            speeds = f"{1e3 * curve.slowest:.0f} to {1e3 * curve.fastest:.0f}"
        cells = [shown(curve.estimates[name]) for name in PARAMETERS]
        table.add_row(Text(run.recording), run.started or "", *cells, speeds)
    return table
