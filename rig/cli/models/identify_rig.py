"""The friction experiment of `rig identify friction --rig`: runs it, shows it, writes it."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click
from rich import box
from rich.table import Table

from estimator.friction import Spring
from rig.cli.application import EXIT_BAD_INPUT, EXIT_STOPPED
from rig.cli.campaigns import CampaignProgress
from rig.cli.screen import Screen
from rig.configuration import Rig, dump_model, plan_campaign
from rig.io import DriverError
from rig.loop import TripError
from rig.plant import Model
from rig.recording import replacing
from rig.report.friction import experiment_page, parameter_rows, remarks
from rig.runner import StopFlag, TestOutcome, stop_on_signals
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    ExperimentStoppedError,
    FrictionExperiment,
    break_away_campaign,
    experiment_figures,
    places_of,
    revised_model,
    run_friction_experiment,
    sliding_campaign,
)
from rig.runner.run_folder import default_directory, make_empty

EXIT_NOT_IDENTIFIED: Final = 1


def show_motions(rig: Rig, assumed: Model) -> int:
    """Print every motion of the experiment as it would run, and move nothing."""
    par = rig.plant.parameters
    null_V = -par.spool_null_bias / par.valve_gain  # noqa: N806
    campaigns = (
        sliding_campaign(rig, assumed),
        break_away_campaign(rig, assumed, null_V, places_of(rig, null_V)),
    )
    minutes, seconds = divmod(round(sum(each.rig_time_s for each in campaigns)), 60)
    click.echo(
        f"friction of {rig.name}: {minutes} min {seconds} s of rig time, "
        f"judged by the model {assumed.name}"
    )
    for campaign in campaigns:
        for test in plan_campaign(campaign, rig):
            for line in test.lines():
                if not line.startswith("  expect"):
                    click.echo(line)
    click.echo(
        "break-away ramps go around the command at which the ram is found to rest; here, by the "
        f"rig's own model, {1e3 * null_V:.1f} mV. Where one does not move the ram it is repeated, "
        "in closed loop"
    )
    return 0


def run_on_rig(
    rig: Rig, assumed: Model, spring: Spring, pace: Pace | None, out: Path | None, *, as_json: bool
) -> int:
    """Run the experiment and write what it found; return the exit code.

    Raises:
        DirectoryError: the folder cannot be used.
    """
    if rig.backend == "hardware" and pace == "fast":
        limit = f"the rig {rig.name} is hardware, which runs at the wall clock"
        click.echo(f"--pace fast: {limit}; leave the option out", err=True)
        return EXIT_BAD_INPUT
    begun = datetime.now(UTC)
    directory = out or default_directory(f"friction-{rig.name}", begun)
    make_empty(directory)
    stop = StopFlag()
    # With --json nothing but the figures goes to stdout.
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    screen.quiet = as_json
    paced = (pace or rig.pace) == "real" or rig.backend == "hardware"
    with stop_on_signals(stop), _Progress(screen, paced=paced) as progress:
        try:
            found = run_friction_experiment(
                rig, assumed, spring, directory, pace=pace, observer=progress, stop=stop
            )
        except DriverError as error:
            click.echo(str(error), err=True)
            return EXIT_BAD_INPUT
        except TripError as error:
            click.echo(f"rig: {error}", err=True)
            return EXIT_STOPPED
        except ExperimentStoppedError as error:
            click.echo(f"rig: {error}; what was recorded is in {directory}", err=True)
            return error.exit_code
    _write(found, directory, f"{begun:%Y-%m-%d %H:%M}")
    if as_json:
        click.echo(json.dumps(experiment_figures(found), allow_nan=False))
    else:
        screen.print(_table(found, plain=not screen.is_terminal))
        for line in remarks(found):
            screen.print(line, soft_wrap=True)
        model = f"model: {directory / 'model.yaml'}" if found.fit else "model: none, see above"
        screen.print(f"{model}\nplots: {directory / 'friction.html'}", soft_wrap=True)
    return 0 if found.fit is not None else EXIT_NOT_IDENTIFIED


def _write(found: FrictionExperiment, directory: Path, started: str) -> None:
    with replacing(directory / "friction.json") as partial:
        figures = json.dumps(experiment_figures(found), indent=1, allow_nan=False)
        partial.write_text(figures + "\n", encoding="utf-8")
    with replacing(directory / "friction.html") as partial:
        partial.write_text(experiment_page(found, started), encoding="utf-8")
    model = revised_model(found, directory, started)
    if model is not None:
        dump_model(model, directory / "model.yaml")


def _table(found: FrictionExperiment, *, plain: bool) -> Table:
    """Return the parameters with their intervals; `plain` draws it with ASCII."""
    table = Table(box=box.ASCII2 if plain else box.ROUNDED)
    table.add_column("parameter")
    table.add_column("unit")
    for heading in ("found", "from slowing down alone", "model"):
        table.add_column(heading, justify="right")
    for row in parameter_rows(found):
        table.add_row(*row)
    return table


class _Progress(CampaignProgress):
    """A line a motion, without the verdicts on leaks that nobody asked for."""

    def test_ends(self, outcome: TestOutcome) -> None:
        """Write the motion's line."""
        super().test_ends(replace(outcome, decision=None))
