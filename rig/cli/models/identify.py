"""`rig identify` learns a rig's friction from recordings, or from an experiment that it runs."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click

from estimator.friction import PARAMETERS, Spring, identify_recording
from rig.cli.application import Problems
from rig.cli.option_types import STREAMED, paced
from rig.cli.screen import Screen
from rig.configuration import Physical, QuantityError, Rig, dump_model, load_model, load_rig
from rig.io import today
from rig.plant import Model, quantities
from rig.recording import Recording, read_recording, replace_text
from rig.report.calibrations import calibration_rows
from rig.report.friction import (
    FrictionRun,
    changes_in_words,
    experiment_page,
    friction_page,
    in_words,
    needs_in_words,
    parameter_rows,
    remarks,
    shown,
)
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    break_away_campaign,
    experiment_figures,
    places_of,
    revised_model,
    run_friction_experiment,
    sliding_campaign,
)
from rig.runner.outcomes import (
    calibrations_recorded,
    calibrations_used,
    change_figures,
    friction_figures,
    model_spring,
    sensors_of,
    spring_of,
)
from rig.runner.run_folder import default_directory

from .experiments import experiment, print_motions, rig_time

_PAGE: Final = Path("friction.html")
EXIT_NOT_IDENTIFIED: Final = 1


@click.group()
def command() -> None:
    """Learn a rig's parameters from recordings or from an experiment."""


@command.command()
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]")
@click.option("--rig", "rig_reference", metavar="RIG", help="Run the experiment on this rig.")
@paced("Of the experiment: at")
@STREAMED
@click.option("--dry-run", is_flag=True, help="Show the experiment's motions, and move nothing.")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option("--spring", metavar="STIFFNESS", help="Spring that was there, such as '2e4 N/m'.")
@click.option("--contact", metavar="POSITION", help="Where the ram meets it, such as '0.22 m'.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="Of recordings: the page with the plots, friction.html if not given. Of an experiment: a "
    "new or empty folder; runs/friction-RIG-TIME if not given.",
)
@click.option("--json", "as_json", is_flag=True, help="One object a line instead of a table.")
def friction(
    recordings: tuple[str, ...],
    rig_reference: str | None,
    pace: Pace | None,
    profile: str | None,
    dry_run: bool,
    model: str,
    spring: str | None,
    contact: str | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Identify friction from recordings, oldest first, or by an experiment on a rig.

    Stiction, Coulomb level, Stribeck velocity, viscous friction and asymmetry with 95 % intervals.

    From recordings (.mcap, .csv, .csv.gz, .parquet), the change from the first to the last is shown
    too, and a page with plots is written. The spring is the one of the options, else of the
    recorded test, else of the model. Where a motion cannot show a parameter, a motion that would is
    named. Exit code 0 whatever is found, 2 if any input is bad.

    With --rig: the ram, unloaded, slows down from fast strokes, goes at constant speeds, and breaks
    away at ten places of the stroke under a slow ramp, 9 minutes in all, within the rig's limits.
    Writes model.yaml, friction.html, friction.json and the recordings. Exit code 0 identified, 1
    not, 2 bad input, 3 stopped or tripped.
    """
    problems = Problems()
    if bool(recordings) == (rig_reference is not None):
        problems.add("give either recordings or --rig, whose friction to identify")
    if rig_reference is None and (pace or profile or dry_run):
        problems.add("--pace, --stream, --dry-run: are of the experiment on a rig; give --rig")
    with problems.collected():
        assumed = load_model(model)
    given = _spring(spring, contact, problems)
    if rig_reference is not None:
        with problems.collected():
            rig = load_rig(rig_reference)
        if problems.found:
            return problems.report()
        if dry_run:
            return _show_motions(rig, assumed)
        spring_there = given or model_spring(assumed)
        return _run_on_rig(rig, assumed, spring_there, pace, profile, out, as_json=as_json)
    out = out or _PAGE
    if out.is_dir():
        problems.add(f"--out: {out} is a folder; name the page's file")
    if not out.parent.is_dir():
        problems.add(f"--out: {out.parent} is no folder; make it first")
    runs: list[FrictionRun] = []
    contents: list[Recording] = []
    for recording in recordings:
        with problems.collected():
            content = read_recording(recording)
            # Once any input is bad, the others are only read to report their problems too.
            if not problems.found:
                runs.append(_run(recording, content, assumed, given))
                contents.append(content)
    if problems.found:
        return problems.report()
    calibrated = calibration_rows(*calibrations_recorded(contents))
    replace_text(out, friction_page(runs, assumed, calibrated))
    if as_json:
        for run in runs:
            changes = change_figures(runs[0].curve, run.curve) if run is not runs[0] else {}
            source = {"recording": run.recording, "name": run.name, "started": run.started}
            figures = source | friction_figures(run.curve) | {"change_from_first": changes}
            click.echo(json.dumps(figures, allow_nan=False))
        return 0
    screen = Screen()
    units = runs[0].curve.estimates
    right = (*(f"{in_words(name)}, {units[name].unit}" for name in PARAMETERS), "speeds, mm/s")
    headings = ("recording", "date", *right)
    screen.print_table(headings, map(_cells, runs), right=right, fold=("recording",))
    for line in changes_in_words(runs):
        screen.print(line)
    for run in runs:
        for need in needs_in_words(run.curve):
            screen.print(f"{run.recording}: {need}")
    screen.print(f"plots: {out}")
    return 0


def _run(name: str, recording: Recording, model: Model, given: Spring | None) -> FrictionRun:
    spring = given or spring_of(recording) or model_spring(model)
    curve = identify_recording(recording, model, spring, sensors_of(recording))
    test, start_ns = (recording.metadata.get(key) for key in ("test", "start_ns"))
    called = test["name"] if isinstance(test, dict) and "name" in test else Path(name).name
    started = None
    if isinstance(start_ns, int) and start_ns > 0:
        started = f"{datetime.fromtimestamp(start_ns / 1e9, UTC):%Y-%m-%d %H:%M}"
    return FrictionRun(name, str(called), started, curve)


def _spring(spring: str | None, contact: str | None, problems: Problems) -> Spring | None:
    """Return the spring that the options give; None if they give none.

    If they give an unusable one, the problems are added and None is returned too.
    """
    if spring is None and contact is None:
        return None
    values = []
    given = {"spring_stiffness": ("--spring", spring), "spring_contact": ("--contact", contact)}
    for parameter, (option, text) in given.items():
        limits = quantities()[parameter]
        if text is None:
            problems.add(f"{option}: a spring has a stiffness and a contact; give both")
            continue
        try:
            values.append(Physical(limits.unit, limits.lower, limits.upper).parse(text))
        except QuantityError as error:
            problems.add(f"{option}: {text} {error}")
    return Spring(*values) if len(values) == 2 else None


def _cells(run: FrictionRun) -> tuple[str, ...]:
    """Return the cells of a recording's row: path, date, each parameter, and range of speeds."""
    curve = run.curve
    speeds = "none"
    if curve.slowest is not None and curve.fastest is not None:
        speeds = f"{1e3 * curve.slowest:.0f} to {1e3 * curve.fastest:.0f}"
    parameters = (shown(curve.estimates[name]) for name in PARAMETERS)
    return run.recording, run.started or "", *parameters, speeds


def _show_motions(rig: Rig, assumed: Model) -> int:
    """Print every motion of the experiment as it would run, and move nothing; return 0."""
    par = rig.plant.parameters
    null_V = -par.spool_null_bias / par.valve_gain  # noqa: N806
    campaigns = (
        sliding_campaign(rig, assumed),
        break_away_campaign(rig, assumed, null_V, places_of(rig, null_V)),
    )
    click.echo(
        f"friction of {rig.name}: {rig_time(campaigns)} of rig time, "
        f"judged by the model {assumed.name}"
    )
    for campaign in campaigns:
        print_motions(campaign, rig)
    click.echo(
        "break-away ramps go around the command at which the ram is found to rest; here, by the "
        f"rig's own model, {1e3 * null_V:.1f} mV. Where one does not move the ram it is repeated, "
        "in closed loop"
    )
    return 0


def _run_on_rig(
    rig: Rig,
    assumed: Model,
    spring: Spring,
    pace: Pace | None,
    profile: str | None,
    out: Path | None,
    *,
    as_json: bool,
) -> int:
    """Run the friction experiment, write and show its results; return the exit code.

    The code is 0 if the friction was identified, else `EXIT_NOT_IDENTIFIED`.

    Raises:
        ConfigError: the profile of the live stream cannot be used.
        DirectoryError: the folder of the results cannot be used.
        click.exceptions.Exit: the pace is impossible, the experiment was stopped, a driver failed
            or the rig tripped. The message is on stderr already.
    """
    begun = datetime.now(UTC)
    directory = out or default_directory(f"friction-{rig.name}", begun)
    watched = experiment(rig, pace, directory, profile, "friction experiment", as_json=as_json)
    with watched as (screen, stop, observer):
        found = run_friction_experiment(
            rig, assumed, spring, directory, pace=pace, observer=observer, stop=stop
        )
    figures, started = experiment_figures(found), f"{begun:%Y-%m-%d %H:%M}"
    text = json.dumps(figures, indent=1, allow_nan=False)
    replace_text(directory / "friction.json", text + "\n")
    used = calibrations_used(rig, (begun.date(), today()))
    calibrated = calibration_rows(used, rig.uncalibrated)
    replace_text(directory / "friction.html", experiment_page(found, started, calibrated))
    revised = revised_model(found, directory, started)
    if revised is not None:
        dump_model(revised, directory / "model.yaml")
    if as_json:
        click.echo(json.dumps(figures, allow_nan=False))
    else:
        right = ("found", "from slowing down alone", "model")
        screen.print_table(("parameter", "unit", *right), parameter_rows(found), right=right)
        for line in remarks(found):
            screen.print(line, soft_wrap=True)
        model = f"model: {directory / 'model.yaml'}" if found.fit else "model: none, see above"
        screen.print(f"{model}\nplots: {directory / 'friction.html'}", soft_wrap=True)
    return 0 if found.fit is not None else EXIT_NOT_IDENTIFIED
