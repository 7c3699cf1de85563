"""What the experiments of `rig gap --live` and `rig identify friction --rig` share."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click

from faults import Campaign
from rig.cli.campaigns import MotionProgress
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import Rig, plan_campaign
from rig.runner import StopFlag, stop_on_signals
from rig.runner.campaign import Pace
from rig.runner.experiments import ExperimentStoppedError


def rig_time(campaigns: Sequence[Campaign]) -> str:
    """Return how long campaigns keep a rig busy, in words."""
    minutes, seconds = divmod(round(sum(each.rig_time_s for each in campaigns)), 60)
    return f"{minutes} min {seconds} s"


def print_motions(campaign: Campaign, rig: Rig, indent: str = "") -> None:
    """Print every motion of a campaign as it would run."""
    for test in plan_campaign(campaign, rig):
        for line in test.lines():
            if not line.startswith("  expect"):
                click.echo(f"{indent}{line}")


@contextmanager
def experiment(
    rig: Rig, pace: Pace | None, folder: Path, *, as_json: bool
) -> Iterator[tuple[Screen, StopFlag, MotionProgress]]:
    """Give screen, stop flag and progress to the block that runs an experiment.

    The command ends if the experiment fails.

    Args:
        rig: that the experiment is run on.
        pace: asked for; the rig's own if None.
        folder: of the experiment's recordings, for messages.
        as_json: whether nothing but the figures goes to the standard output.

    Raises:
        click.exceptions.Exit: the message is written; the error has the exit code.
    """
    stop = StopFlag()
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    screen.quiet = as_json
    paced = (pace or rig.pace) == "real" or rig.backend == "hardware"
    with stop_on_signals(stop), MotionProgress(screen, paced=paced) as progress:
        try:
            with failures_reported():
                yield screen, stop, progress
        except ExperimentStoppedError as error:
            click.echo(f"rig: {error}; what was recorded is in {folder}", err=True)
            raise click.exceptions.Exit(error.exit_code) from error
