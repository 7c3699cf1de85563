"""`rig calibrate` measures values that a rig file otherwise has from data sheets."""

import csv
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click
import numpy as np

from control import RequestError
from estimator.filters import DEFAULT_FILTER
from faults import Measurement, NeedleCalibration, to_litres_per_minute
from rig.channels import BYPASSES
from rig.cli.application import EXIT_BAD_INPUT, ending
from rig.cli.live_stream import session_streamed, stream_of
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import dump_calibration, load_model, load_rig
from rig.runner import StopFlag, stop_on_signals
from rig.runner.campaign import WITHOUT_TESTS, Needs, compile_for
from rig.runner.run_folder import file_stem
from rig.supervisor import ConnectedRig, Session, Strokes, calibratable, calibrate

_FOLDER: Final = Path("calibrations")
_UNIT: Final = "m^3/(s Pa^0.5)"
_RAW: Final = (
    "bypass", "opening", "direction", "feedback", "flow_m3_per_s", "flow_error_m3_per_s", "drop_Pa",
    "coefficient", "coefficient_error",
)  # fmt: skip
"""Columns of the file of raw measurements.

Values are in SI; coefficients are of ball and needle in series; errors are standard errors.
"""


@click.group()
def command() -> None:
    """Measure values that a rig file otherwise has from data sheets."""


@command.command()
@click.option("--rig", "reference", metavar="RIG", required=True, help="A hardware rig.")
@click.option(
    "--valve",
    "asked",
    type=click.Choice(BYPASSES),
    multiple=True,
    metavar="KIND",
    help="The bypass that makes this fault; may be repeated. All with a flow meter if not given.",
)
@click.option(
    "--points",
    type=click.IntRange(2, 101),
    default=11,
    show_default=True,
    help="Openings of the needle, each measured on the way up and down.",
)
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="A new file for the table. Default: calibrations/RIG-TIME.yaml.",
)
@STREAMED
def valves(
    reference: str,
    asked: tuple[str, ...],
    points: int,
    model: str,
    out: Path | None,
    profile: str | None,
) -> int:
    """Measure needle opening against leakage coefficient with the flow meters.

    The rig is armed and homed; the ram then makes a slow stroke of some 9 s for each point, on the
    way up and again on the way down, and up to three where the flow does not settle. Writes a dated
    file for `needle: {calibration: FILE}` in the rig file, and beside it the measurements as CSV.
    Exit code: 0 done, 2 bad input or no calibration, 3 stopped or tripped.
    """
    rig, assumed = load_rig(reference), load_model(model)
    wanted = calibratable(rig, asked)
    started = datetime.now(UTC)
    path = out or _FOLDER / f"{file_stem(rig.name)}-{started:%Y%m%dT%H%M%SZ}.yaml"
    raw = path.with_suffix(".csv")
    for file in (path, raw):
        if file.exists():
            raise click.BadParameter(f"{file} exists; name a new file", param_hint="--out")
    settings = stream_of(profile, paced=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    screen, stop = Screen(), StopFlag()

    def on_measured(kind: str, measurement: Measurement) -> None:
        _keep(raw, kind, measurement)
        flow, error = (to_litres_per_minute(value) for value in measurement.flow)
        screen.print(
            f"{kind} {measurement.opening:g} {_direction(measurement)}: {flow:.3f} ± {error:.3f} "
            f"L/min at {1e-6 * measurement.drop_Pa:.2f} MPa",
            soft_wrap=True,
        )

    openings = [round(float(opening), 4) for opening in np.linspace(0.0, 1.0, points)]
    lost = f"\nno calibration; what was measured: {raw}"
    with (
        ending(EXIT_BAD_INPUT, RequestError, after=lost),
        failures_reported(),
        stop_on_signals(stop),
    ):
        compile_for(Needs(rig, DEFAULT_FILTER), WITHOUT_TESTS, screen.print, stop)
        activity = "calibrating the bypass valves"
        with session_streamed(settings, rig, path.parent, stop, activity, screen.print) as (
            say,
            onlooker,
        ):
            connected = ConnectedRig(rig, DEFAULT_FILTER, assumed, path.parent, stop, say, onlooker)
            with Session(connected):
                needles = calibrate(
                    Strokes(connected), wanted, openings, assumed.parameters.return_pressure,
                    started.date(), on_measured,
                )  # fmt: skip
    dump_calibration(path, rig.name, started.date(), needles)
    right = ("opening", "coefficient", "± standard error", "up - down")
    title = f"Coefficients in {_UNIT}"
    screen.print_table(("bypass", *right), _rows(needles), right=right, title=title)
    screen.print(f"calibration: {path}\nmeasurements: {raw}", soft_wrap=True)
    return 0


def _keep(path: Path, kind: str, measurement: Measurement) -> None:
    """Append a measurement to a CSV file at once, so that a trip loses no earlier measurement."""
    rows: list[tuple[object, ...]] = [] if path.exists() else [_RAW]
    rows.append(
        (kind, measurement.opening, _direction(measurement), measurement.feedback,
         *measurement.flow, measurement.drop_Pa, *measurement.coefficient)
    )  # fmt: skip
    with path.open("a", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def _direction(measurement: Measurement) -> str:
    return "up" if measurement.upwards else "down"


def _rows(needles: Mapping[str, NeedleCalibration]) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a row for each needle's points, with a line below each needle."""
    for kind, calibration in needles.items():
        for point in calibration.points:
            value, error = point.coefficient
            found = (f"at most {point.bound:.1e}", "", "")
            if point.coefficient.is_resolved:
                found = (f"{value:.4g}", f"{error:.1e}", f"{point.hysteresis:+.1e}")
            yield kind, f"{point.opening:g}", *found
        yield ()
