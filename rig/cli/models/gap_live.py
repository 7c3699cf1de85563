"""`rig gap --live` runs motions on a rig and closes the gap of its model."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import click
import yaml

from estimator.gap import GapResult, Wanted
from rig.cli.application import EXIT_CRASHED
from rig.cli.rig_failures import require_possible_pace
from rig.configuration import Rig
from rig.plant import Model
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    CHECK,
    EXPERIMENT_S,
    FITTED,
    HELD,
    ApartError,
    apart,
    close_gap,
    motions_campaign,
)
from rig.runner.run_folder import make_empty

from .experiments import experiment, print_motions, rig_time

LONGEST: Final = "each experiment {:g} s more, with a check after it"


def show_motions(rig: Rig, assumed: Model) -> int:
    """Print the motions of the first round as they would run, and move nothing; return 0."""
    campaigns = (
        motions_campaign("held out", HELD, rig, assumed, 1),
        motions_campaign("round 1", FITTED, rig, assumed, 1),
        motions_campaign("check", CHECK, rig, assumed, 501),
    )
    click.echo(
        f"gap of {rig.name} to the model {assumed.name}: {rig_time(campaigns)} of rig time in "
        f"one round; {LONGEST.format(EXPERIMENT_S)}"
    )
    for campaign in campaigns:
        click.echo(f"{campaign.name}:")
        print_motions(campaign, rig, indent="  ")
    return 0


def close_on_rig(
    rig: Rig,
    given: Model,
    pace: Pace | None,
    rounds: int,
    out: Path,
    wanted: Wanted,
    *,
    as_json: bool,
) -> GapResult:
    """Close the gap of a model by motions on a rig, and return the result.

    Args:
        rig: the rig that is moved.
        given: the model to start from.
        pace: the pace that the user asks for; None for the rig's own.
        rounds: the most rounds of motions and revisions.
        out: new or empty folder for the recordings.
        wanted: what the revised model may hold of what is discovered.
        as_json: whether the screen stays silent.

    Raises:
        DirectoryError: the folder cannot be used.
        click.exceptions.Exit: the pace is impossible, the experiment was stopped, a driver failed,
            the rig tripped, or the search for effects died. The message is on stderr already, and
            the error has the exit code.
    """
    require_possible_pace(rig, pace)
    make_empty(out)
    seed = int(datetime.now(UTC).timestamp()) % 1_000_000
    with experiment(rig, pace, out, as_json=as_json) as (_, stop, progress):
        try:
            return close_gap(
                rig, given, out, rounds=rounds, wanted=wanted, pace=pace, observer=progress,
                stop=stop, worker=apart, seed=seed,
            )  # fmt: skip
        except ApartError as error:
            click.echo(f"rig: nothing was found: {error}; recordings are in {out}", err=True)
            raise click.exceptions.Exit(EXIT_CRASHED) from error


def experiment_file(campaign: Mapping[str, Any], rig: str, model: str) -> str:
    """Return the text of a campaign file that runs the experiment `campaign` on a rig.

    `rig` and `model` are names or paths; a path to a file is made absolute.
    """
    content = {
        "name": campaign["name"],
        "description": campaign["description"],
        "rig": _reference(rig),
        "model": _reference(model),
        "tests": json.loads(json.dumps(campaign["tests"])),
    }
    head = "# Written by rig gap: tells apart what its recordings could not. Look at it first:\n"
    body = yaml.safe_dump(content, sort_keys=False)
    return f"{head}# rig check this file, then rig run it.\n{body}"


def _reference(reference: str) -> str:
    """Return the absolute path of a file; return the reference unchanged if it is no file."""
    path = Path(reference).expanduser()
    return str(path.resolve()) if path.is_file() else reference
