"""`rig gap --live`: runs motions on a rig and closes the gap of its model."""

import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import click
import yaml

from estimator.gap import GapResult
from rig.cli.application import EXIT_BAD_INPUT, EXIT_CRASHED, EXIT_STOPPED
from rig.cli.campaigns import CampaignProgress
from rig.cli.screen import Screen
from rig.configuration import Rig, plan_campaign
from rig.io import DriverError
from rig.loop import StopRequestedError, TripError
from rig.plant import Model
from rig.runner import StopFlag, TestOutcome, stop_on_signals
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    ApartError,
    ExperimentStoppedError,
    Programme,
    apart,
    close_gap,
    motions_campaign,
)
from rig.runner.run_folder import make_empty

LONGEST: Final = "each experiment {:g} s more, with a check after it"


def show_motions(rig: Rig, assumed: Model) -> int:
    """Print every motion as it would run, and move nothing."""
    plan = Programme()
    campaigns = (
        motions_campaign("held out", plan.held, rig, assumed, 1),
        motions_campaign("round 1", plan.fitted, rig, assumed, 1),
        motions_campaign("check", plan.check, rig, assumed, 501),
    )
    minutes, seconds = divmod(round(sum(each.rig_time_s for each in campaigns)), 60)
    click.echo(
        f"gap of {rig.name} to the model {assumed.name}: {minutes} min {seconds} s of rig time in "
        f"one round; {LONGEST.format(plan.experiment_s)}"
    )
    for campaign in campaigns:
        click.echo(f"{campaign.name}:")
        for test in plan_campaign(campaign, rig):
            for line in test.lines():
                if not line.startswith("  expect"):
                    click.echo(f"  {line}")
    return 0


def close_on_rig(
    rig: Rig, given: Model, pace: Pace | None, rounds: int, out: Path, *, as_json: bool
) -> GapResult | int:
    """Close the gap of a model on a rig; return what was found, or the exit code of a failure.

    Raises:
        DirectoryError: the folder cannot be used.
    """
    if rig.backend == "hardware" and pace == "fast":
        limit = f"the rig {rig.name} is hardware, which runs at the wall clock"
        click.echo(f"--pace fast: {limit}; leave the option out", err=True)
        return EXIT_BAD_INPUT
    make_empty(out)
    stop = StopFlag()
    # With --json nothing but the figures goes to stdout.
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    screen.quiet = as_json
    paced = (pace or rig.pace) == "real" or rig.backend == "hardware"
    seed = int(datetime.now(UTC).timestamp()) % 1_000_000
    with stop_on_signals(stop), _Progress(screen, paced=paced) as progress:
        try:
            return close_gap(
                rig, given, out, rounds=rounds, pace=pace, observer=progress, stop=stop,
                worker=apart, seed=seed,
            )  # fmt: skip
        except DriverError as error:
            click.echo(str(error), err=True)
            return EXIT_BAD_INPUT
        except (TripError, StopRequestedError) as error:
            click.echo(f"rig: {error}", err=True)
            return EXIT_STOPPED
        except ExperimentStoppedError as error:
            click.echo(f"rig: {error}; what was recorded is in {out}", err=True)
            return error.exit_code
        except ApartError as error:
            click.echo(f"rig: nothing was found: {error}; recordings are in {out}", err=True)
            return EXIT_CRASHED


def experiment_file(campaign: Mapping[str, Any], rig: str, model: str) -> str:
    """Return the text of a campaign file that runs an experiment on a rig."""
    told = {
        "name": campaign["name"],
        "description": campaign["description"],
        "rig": _reference(rig),
        "model": _reference(model),
        "tests": json.loads(json.dumps(campaign["tests"])),
    }
    head = "# Written by rig gap: tells apart what its recordings could not. Look at it first:\n"
    return f"{head}# rig check this file, then rig run it.\n{yaml.safe_dump(told, sort_keys=False)}"


def _reference(reference: str) -> str:
    """Return a name as it is, and the path of a file so that it is found from any folder."""
    path = Path(reference).expanduser()
    return str(path.resolve()) if path.is_file() else reference


class _Progress(CampaignProgress):
    """A line a motion, without the verdicts on leaks that nobody asked for."""

    def test_ends(self, outcome: TestOutcome) -> None:
        """Write the motion's line."""
        super().test_ends(replace(outcome, decision=None))
