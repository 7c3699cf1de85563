"""The page of `rig commission`: what was found, what was changed, what could not be found."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from rig.plant import TICK
from rig.report.panel import line
from rig.report.templating import rendered
from rig.runner.commissioning import Finding, Signs

MM: Final = 1e3
MPA: Final = 1e-6


def commissioning_page(
    rig: str,
    started: str,
    findings: Sequence[Finding],
    written: Sequence[str],
    signs: Signs | None,
    ended: str,
) -> str:
    """Return the HTML page of a commissioning.

    Args:
        rig: name of the rig.
        started: when it began, UTC, as text.
        findings: what was looked for.
        written: what was written, a line each.
        signs: what the first motions showed; None if they did not get so far.
        ended: why it ended early; empty if it did not.
    """
    return rendered(
        "commissioning.html.j2",
        "motions.js",
        rig=rig,
        started=started,
        findings=findings,
        changed=[each for each in findings if each.standing == "changed"],
        missing=[each for each in findings if each.standing == "not found"],
        written=written,
        ended=ended,
        figures=_figures(signs) if signs is not None else [],
    )


def finding_rows(findings: Sequence[Finding]) -> list[tuple[str, ...]]:
    """Return the cells of a table, one row for each finding, without its remark."""
    return [
        (each.subject, each.found or "-", each.before or "-", each.standing) for each in findings
    ]


def _figures(signs: Signs) -> list[dict[str, Any]]:
    """Return the plots of the first commands: way by the encoder, and load pressure."""
    command, position, pressure_1, pressure_2 = signs.rows.T[:4]
    time_s = np.arange(len(command), dtype=np.float64) * TICK
    asked = line("command, V", "reference", time_s, command, width=2.0)
    shown = (
        ("way by the encoder", "mm", "way, mm", MM * (position - position[0])),
        ("load pressure", "MPa", "pressure 1 less 2, MPa", MPA * (pressure_1 - pressure_2)),
    )
    return [
        {
            "title": title,
            "unit": unit,
            "traces": [asked.plotly, line(name, "found", time_s, values).plotly],
        }
        for title, unit, name, values in shown
    ]
