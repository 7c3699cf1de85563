"""Functions that `rig gap --live` and `rig identify friction --rig` share."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from faults import Campaign
from rig.cli.campaigns import MotionProgress
from rig.cli.live_stream import motion_streamed, stream_of
from rig.cli.rig_failures import failures_reported, require_possible_pace
from rig.cli.screen import Screen
from rig.configuration import Rig, plan_campaign
from rig.runner import Observer, StopFlag, stop_on_signals
from rig.runner.campaign import Pace
from rig.runner.experiments import ExperimentStoppedError
from rig.runner.run_folder import make_empty
from rig.stream import StreamSettings


def rig_time(campaigns: Sequence[Campaign]) -> str:
    """Return how long campaigns keep a rig busy altogether, in words such as "3 min 5 s"."""
    minutes, seconds = divmod(round(sum(each.rig_time_s for each in campaigns)), 60)
    return f"{minutes} min {seconds} s"


def print_motions(campaign: Campaign, rig: Rig, indent: str = "") -> None:
    """Print the plan of every motion of a campaign, without expected verdicts; move nothing.

    Each line begins with `indent`.
    """
    for test in plan_campaign(campaign, rig):
        for line in test.lines():
            if not line.startswith("  expect"):
                click.echo(f"{indent}{line}")


@contextmanager
def experiment(
    rig: Rig, pace: Pace | None, folder: Path, profile: str | None, activity: str, *, as_json: bool
) -> Iterator[tuple[Screen, StopFlag, Observer]]:
    """Give screen, stop flag and observer to the block, which runs an experiment.

    The folder is made before, and is removed if it was new and the experiment failed without
    writing anything, as on a rig that is in use. While the block runs, Ctrl-C, signals to end and
    operators on the live stream request a stop on the flag. The observer shows the progress here
    and on the stream. If the block fails in one of the ways below, the command ends.

    Args:
        rig: the rig on which the experiment is run.
        pace: the pace that the user asks for; None for the rig's own.
        folder: folder for the experiment's recordings, which must be new or empty.
        profile: profile of the live stream, as the user gives it.
        activity: what is done with the rig, such as "tuning", for those who watch it.
        as_json: whether the screen stays silent, so that only the JSON goes to standard output.

    Raises:
        ConfigError: the profile of the stream cannot be used.
        DirectoryError: the folder cannot be used.
        click.exceptions.Exit: the pace is impossible, the experiment was stopped, a driver failed
            or the rig tripped. The message is on stderr already; the error has the exit code. Other
            errors pass unchanged.
    """
    require_possible_pace(rig, pace)
    paced = (pace or rig.pace) == "real" or rig.backend == "hardware"
    settings = stream_of(profile, paced=paced)
    existed = folder.exists()
    make_empty(folder)
    try:
        with _watched(rig, settings, folder, activity, paced=paced, as_json=as_json) as watched:
            yield watched
    except BaseException:
        if not existed:
            # A folder that is not empty stays.
            with suppress(OSError):
                folder.rmdir()
        raise


@contextmanager
def _watched(
    rig: Rig,
    settings: StreamSettings | None,
    folder: Path,
    activity: str,
    *,
    paced: bool,
    as_json: bool,
) -> Iterator[tuple[Screen, StopFlag, Observer]]:
    """Give screen, stop flag and observer to the block, as `experiment` does, in a folder."""
    stop = StopFlag()
    screen = Screen(on_closed=lambda: stop.request("the end of its output"))
    screen.quiet = as_json
    with stop_on_signals(stop), MotionProgress(screen, paced=paced) as progress:
        seen = motion_streamed(progress, settings, rig, folder, stop, activity, paced=paced)
        try:
            with failures_reported(), seen as observer:
                yield screen, stop, observer
        except ExperimentStoppedError as error:
            is_recorded = folder.is_dir() and any(folder.iterdir())
            what = f"what was recorded is in {folder}" if is_recorded else "nothing was recorded"
            click.echo(f"rig: {error}; {what}", err=True)
            raise click.exceptions.Exit(error.exit_code) from error
