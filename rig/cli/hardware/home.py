"""`rig home` arms and homes a rig, to see that it can be homed, and leaves it safe."""

import contextlib
from datetime import UTC, datetime

import click

from estimator.filters import DEFAULT_FILTER
from rig.cli.live_stream import session_streamed, stream_of
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import load_model, load_rig
from rig.runner import StopFlag, stop_on_signals
from rig.runner.campaign import WITHOUT_TESTS, Needs, compile_for
from rig.runner.run_folder import default_directory
from rig.supervisor import ConnectedRig, Session


@click.command()
@click.option("--rig", "reference", metavar="RIG", required=True, help="A hardware rig.")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@STREAMED
def command(reference: str, model: str, profile: str | None) -> int:
    """Arm and home a rig; show where its encoder's zero is, and how well that repeats.

    Who watches the live stream sees it, and may stop it. The rig is left safe; the next command
    that runs on it homes it again. A trip is reported in a folder below `runs`.
    Exit code: 0 homed, 2 bad input, 3 stopped or tripped.
    """
    rig, assumed = load_rig(reference), load_model(model)
    if rig.backend != "hardware" or rig.homing is None:
        needed = "give a rig with `backend: hardware` and `homing`"
        raise click.BadParameter(f"{rig.name} has no encoder to home; {needed}", param_hint="--rig")
    settings = stream_of(profile, paced=True)
    directory = default_directory(f"home-{rig.name}", datetime.now(UTC))
    directory.mkdir(parents=True)
    stop, screen = StopFlag(), Screen()
    try:
        with failures_reported(), stop_on_signals(stop):
            compile_for(Needs(rig, DEFAULT_FILTER), WITHOUT_TESTS, screen.print, stop)
            streamed = session_streamed(settings, rig, directory, stop, "homing", screen.print)
            with streamed as (say, onlooker):
                connected = ConnectedRig(
                    rig, DEFAULT_FILTER, assumed, directory, stop, say, onlooker
                )
                with Session(connected):
                    return 0
    finally:
        # The folder is empty, and is removed, unless the rig tripped.
        with contextlib.suppress(OSError):
            directory.rmdir()
