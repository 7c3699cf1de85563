"""These functions run, show and write the experiment of `rig identify friction --rig`."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click

from estimator.friction import Spring
from rig.cli.rig_failures import require_possible_pace
from rig.configuration import Rig, dump_model
from rig.plant import Model
from rig.recording import replace_text
from rig.report.friction import experiment_page, parameter_rows, remarks
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    FrictionExperiment,
    break_away_campaign,
    experiment_figures,
    places_of,
    revised_model,
    run_friction_experiment,
    sliding_campaign,
)
from rig.runner.run_folder import default_directory, make_empty

from .experiments import experiment, print_motions, rig_time

EXIT_NOT_IDENTIFIED: Final = 1


def show_motions(rig: Rig, assumed: Model) -> int:
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


def run_on_rig(
    rig: Rig, assumed: Model, spring: Spring, pace: Pace | None, out: Path | None, *, as_json: bool
) -> int:
    """Run the friction experiment, write and show its results; return the exit code.

    The code is 0 if the friction was identified, else `EXIT_NOT_IDENTIFIED`.

    Raises:
        DirectoryError: the folder cannot be used.
        click.exceptions.Exit: the pace is impossible, the experiment was stopped, a driver failed
            or the rig tripped. The message is on stderr already, and the error has the exit code.
    """
    require_possible_pace(rig, pace)
    begun = datetime.now(UTC)
    directory = out or default_directory(f"friction-{rig.name}", begun)
    make_empty(directory)
    with experiment(rig, pace, directory, as_json=as_json) as (screen, stop, progress):
        found = run_friction_experiment(
            rig, assumed, spring, directory, pace=pace, observer=progress, stop=stop
        )
    _write(found, directory, f"{begun:%Y-%m-%d %H:%M}")
    if as_json:
        click.echo(json.dumps(experiment_figures(found), allow_nan=False))
    else:
        right = ("found", "from slowing down alone", "model")
        screen.print_table(("parameter", "unit", *right), parameter_rows(found), right=right)
        for line in remarks(found):
            screen.print(line, soft_wrap=True)
        model = f"model: {directory / 'model.yaml'}" if found.fit else "model: none, see above"
        screen.print(f"{model}\nplots: {directory / 'friction.html'}", soft_wrap=True)
    return 0 if found.fit is not None else EXIT_NOT_IDENTIFIED


def _write(found: FrictionExperiment, directory: Path, started: str) -> None:
    figures = json.dumps(experiment_figures(found), indent=1, allow_nan=False)
    replace_text(directory / "friction.json", figures + "\n")
    replace_text(directory / "friction.html", experiment_page(found, started))
    model = revised_model(found, directory, started)
    if model is not None:
        dump_model(model, directory / "model.yaml")
