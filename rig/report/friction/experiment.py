"""Makes the page of `rig identify friction --rig`: figure 3.1 of the thesis, and the results."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from estimator.friction import (
    DISAGREEMENT,
    PARAMETERS,
    BreakAway,
    SteadySpeed,
    model_curve,
    steady_among,
)
from rig.report.calibrations import CalibrationRow
from rig.report.templating import number, numbers, rendered
from rig.runner.experiments import FrictionExperiment

from .page import INTERVAL, MM, SLOWEST, both_ways, in_words, needs_in_words, shown

_MISFIT: Final = 4.0
"""Limit of chi^2 over its degrees of freedom; measurements that agree with the law exceed it less
than once in 100."""


def experiment_page(
    experiment: FrictionExperiment, started: str, calibrations: Sequence[CalibrationRow] = ()
) -> str:
    """Return the HTML page of a friction experiment.

    Args:
        experiment: the results of the experiment.
        started: when the experiment began, UTC, as text.
        calibrations: rows of the table of calibrations; none if no transducer has one.
    """
    return rendered(
        "friction_experiment.html.j2",
        "friction_experiment.js",
        rig=experiment.rig,
        model=experiment.assumed.name,
        started=started,
        parameters=list(parameter_rows(experiment)),
        remarks=list(remarks(experiment)),
        calibrations=calibrations,
        figures={"places": _places(experiment), "curve": _curve(experiment)},
    )


def parameter_rows(experiment: FrictionExperiment) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield for each friction parameter five texts of the page's table.

    They are its name, its unit, the fitted value with its 95 % interval, the value from slowing
    down alone, and the value of the assumed model.
    """
    for name in PARAMETERS:
        alone = experiment.sliding.estimates[name]
        fitted = alone if experiment.fit is None else experiment.fit.estimates[name]
        found = "not shown" if experiment.fit is None else shown(fitted)
        assumed = getattr(experiment.assumed.parameters, name)
        yield in_words(name), alone.unit, found, shown(alone), f"{assumed:g}"


def remarks(experiment: FrictionExperiment) -> Iterator[str]:
    """Yield sentences on how stiction was measured, and on results that are doubtful."""
    level, fit = experiment.level, experiment.fit
    counted = len(steady_among(experiment.speeds, experiment.sliding))
    if level.places:
        spread = f"{level.level:.0f} ± {INTERVAL * level.level_error:.1f} N"
        yield f"break-away at {level.places} places, both ways: {spread} on average"
        if fit is not None:
            half = INTERVAL * fit.measured_error
            yield (
                f"stiction measured: {fit.measured_stiction:.0f} ± {half:.1f} N, with "
                f"{fit.deficit:.1f} N added for bristles that creep before they slip"
            )
    else:
        yield "break-away: not measured; the ram took off both ways at too few places"
    trend = level.level_trend
    if trend.significant:
        yield (
            f"stiction depends on the position: {trend.slope:+.0f} ± "
            f"{INTERVAL * trend.standard_error:.0f} N/m; the law has its mean only"
        )
    elif level.places:
        yield "stiction does not depend on the position, as far as this shows"
    trend = level.offset_trend
    if trend.significant:
        yield (
            f"a constant force grows along the stroke by {trend.slope:+.0f} ± "
            f"{INTERVAL * trend.standard_error:.0f} N/m, as a spring makes: tell it with --spring"
        )
    yield f"constant speed: {counted} of {len(experiment.speeds)} strokes were steady and are used"
    if fit is None:
        yield from needs_in_words(experiment.sliding)
        return
    if abs(fit.disagreement) > DISAGREEMENT:
        yield (
            f"stiction measured and extrapolated differ by {fit.disagreement:+.1f} standard "
            "errors: friction does not fall exponentially; believe the points, not the curve"
        )
    if fit.misfit > _MISFIT:
        yield f"the law misses the points by more than their errors: {fit.misfit:.1f} times"


def _places(experiment: FrictionExperiment) -> dict[str, Any]:
    """Return the plot of break-away force over position: points and mean level by direction."""
    level = experiment.level
    drawn: dict[str, Any] = {"points": [], "levels": []}
    for direction, name in ((1, "extending"), (-1, "retracting")):
        found = [each for place in experiment.places for each in place
                 if each.direction == direction]  # fmt: skip
        positions = [each.position for each in found]
        opened = [not each.taken_off for each in found]
        drawn["points"].append({"name": name, **_points(positions, found, opened)})
        if level.places:
            drawn["levels"].append(number(level.offset + direction * level.level))
    return drawn


def _curve(experiment: FrictionExperiment) -> dict[str, Any]:
    """Return the plot of figure 3.1: force over velocity, with the fitted curve and its band."""
    speeds, bins = experiment.speeds, experiment.sliding.bins
    velocities = [each.velocity for each in speeds]
    fastest = max([experiment.sliding.fastest or 0.0, *map(abs, velocities)])
    over = both_ways(SLOWEST, fastest or 0.5)
    counted = steady_among(speeds, experiment.sliding)
    taken_off = (each for place in experiment.places for each in place if each.taken_off)
    drawn: dict[str, Any] = {
        "x": numbers(MM * over),
        "model": numbers(model_curve(over, experiment.assumed.parameters)),
        "speeds": _points(velocities, speeds, [each not in counted for each in speeds]),
        "slowing": {
            "x": numbers(MM * each.velocity for each in bins),
            "y": numbers(each.force for each in bins),
        },
        "break_away": numbers(each.force for each in taken_off),
        "fitted": None,
    }
    if experiment.fit is not None:
        force, half = experiment.fit.force(over), INTERVAL * experiment.fit.force_error(over)
        drawn["fitted"] = numbers(force)
        drawn["upper"], drawn["lower"] = numbers(force + half), numbers(force - half)
    return drawn


def _points(
    across: Sequence[float], found: Sequence[BreakAway | SteadySpeed], opened: Sequence[bool]
) -> dict[str, Any]:
    """Return measured forces in N over positions or velocities, as points of a plot.

    Positions in m become mm, velocities in m/s become mm/s. `half` is half the width of a force's
    95 % interval; `opened` says of each point whether it is drawn open, as not used.
    """
    return {
        "x": numbers(MM * each for each in across),
        "y": numbers(each.force for each in found),
        "half": numbers(INTERVAL * each.standard_error for each in found),
        "open": opened,
    }
