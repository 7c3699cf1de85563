"""The page of `rig tune`: margins at every place, and the response before and after."""

from collections.abc import Sequence
from math import degrees, isfinite, pi
from typing import Any, Final

from control import LEAST_GAIN_MARGIN_DB, LEAST_PHASE_MARGIN, Margins
from rig.configuration import control_lines
from rig.report.calibrations import CalibrationRow
from rig.report.panel import Trace, line
from rig.report.templating import rendered
from rig.runner.experiments import Response, Tuning

MM: Final = 1e3


def tuning_page(
    tuning: Tuning,
    started: str,
    written: Sequence[str] = (),
    calibrations: Sequence[CalibrationRow] = (),
) -> str:
    """Return the HTML page of a tuning experiment.

    Args:
        tuning: the results.
        started: when the experiment began, UTC, as text.
        written: a line for each file that was written, the rig file and its backup.
        calibrations: rows of the table of calibrations; none if no transducer has one.
    """
    return rendered(
        "tuning.html.j2",
        "motions.js",
        tuning=tuning,
        started=started,
        rows=list(margin_rows(tuning)),
        section="\n".join(list(control_lines(tuning.proposed, ""))[1:]),
        responses=[response_line(each) for each in tuning.responses],
        least=least_margins(tuning),
        hold=hold_line(tuning),
        written=written,
        calibrations=calibrations,
        figures=[_figure(each, error) for each in tuning.responses for error in (False, True)],
    )


def least_margins(tuning: Tuning) -> str:
    """Return in a sentence the least margins under the proposed control, and those it must keep."""
    gain_dB = min(each.gain_dB for each in tuning.margins_after)  # noqa: N806
    phase = min(each.phase for each in tuning.margins_after)
    return (
        f"The least margins of all places are {gain_dB:.1f} dB and {degrees(phase):.0f} degrees; "
        f"{LEAST_GAIN_MARGIN_DB:g} dB and {degrees(LEAST_PHASE_MARGIN):.0f} degrees are required."
    )


def hold_line(tuning: Tuning) -> str:
    """Return in a sentence how far the held ram swung under the proposed control."""
    if not isfinite(tuning.swing_m):
        return "A ram held at mid stroke gave no reading of its position."
    return (
        f"A ram held at mid stroke stayed within {MM * tuning.swing_m:.2g} mm; it is said to hunt "
        f"from {MM * tuning.swing_limit_m:.2g} mm on."
    )


def margin_rows(tuning: Tuning) -> list[tuple[str, ...]]:
    """Return the cells of a table, one row for each stretch: model, margins before and after."""
    rows: list[tuple[str, ...]] = []
    for model, before, after in zip(
        tuning.models, tuning.margins_before, tuning.margins_after, strict=True
    ):
        rows.append(
            (
                f"{MM * model.position:.0f} {'out' if model.extending else 'back'}",
                f"{MM * model.speed_per_volt:.1f}",
                f"{MM * model.lag_s:.1f}",
                f"{model.misfit:.1%}",
                *_margins(before),
                *_margins(after),
            )
        )
    return rows


def _margins(found: Margins) -> tuple[str, str, str]:
    crossover = f"{found.crossover / (2.0 * pi):.2f}"
    return f"{found.gain_dB:.1f}", f"{degrees(found.phase):.0f}", crossover


def response_line(response: Response) -> str:
    """Return what came of a motion before and after as a line of text."""
    before, after = (f"{MM * rms:.2f} mm rms" for rms in response.rms())
    steps = response.steps()
    if steps is not None:
        before, after = f"{before}, {_answer(*steps[0])}", f"{after}, {_answer(*steps[1])}"
    return f"{response.name}: before {before}; after {after}"


def _answer(overshoot: float, settling_s: float) -> str:
    settled = f"in {settling_s:.2f} s" if isfinite(settling_s) else "not before the next step"
    return f"overshoot {100.0 * overshoot:.1f} %, within 5 % of a step {settled}"


def _figure(response: Response, error: bool) -> dict[str, Any]:
    """Return the plot of a motion: positions, or errors, before and after."""
    time_s, asked = response.time_s, response.setpoint
    traces: list[Trace] = []
    if not error:
        traces.append(line("setpoint", "reference", time_s, MM * asked, width=2.5))
    for name, role, found in (
        ("before", "chamber_2", response.before),
        ("after", "found", response.after),
    ):
        traces.append(line(name, role, time_s, MM * (asked - found if error else found)))
    return {
        "title": f"{response.name}, {'error' if error else 'position'}",
        "unit": "mm",
        "traces": [each.plotly for each in traces],
    }
