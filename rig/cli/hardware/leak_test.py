"""`rig leak-test` locks a rig's cylinder by its blocking valves and measures its leaks."""

import json
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click

from estimator.filters import DEFAULT_FILTER
from estimator.leak_test import LeakTestError, Soak
from rig.cli.application import EXIT_STOPPED, ending
from rig.cli.live_stream import session_streamed, stream_of
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import Rig, load_model, load_rig
from rig.plant import Model
from rig.recording import replace_text
from rig.report.leak_test import HEADINGS, leak_rows, leak_sentences, leak_test_page
from rig.runner import StopFlag, stop_on_signals
from rig.runner.campaign import WITHOUT_TESTS, Needs, compile_for
from rig.runner.leak_test import (
    LeakTest,
    SimulatedLockable,
    StoppedError,
    could_see,
    leak_test_figures,
    run_connected_leak_test,
    run_leak_test,
)
from rig.runner.run_folder import default_directory, make_empty
from rig.stream import StreamSettings

EXIT_LEAK: Final = 1


@click.command()
@click.argument("reference", metavar="RIG")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--seed", type=click.IntRange(min=0), help="Of a simulated rig's noise; 0 if not given."
)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="A new or empty folder for the results; runs/leak-test-RIG-TIME if not given.",
)
@click.option("--json", "as_json", is_flag=True, help="One object instead of a table.")
@STREAMED
def command(
    reference: str,
    model: str,
    seed: int | None,
    folder: Path | None,
    as_json: bool,
    profile: str | None,
) -> int:
    """Lock the cylinder of RIG, a file or a shipped name, and measure its leaks in half a minute.

    The servovalve brings both chambers to three pressures in turn; each time the blocking valves
    lock them, and the decay of the pressures is watched for 6 s. The leaks out of both chambers and
    across the piston are fitted together, with temperature drift, creep, and the blocking valves'
    own leak within its data sheet. Writes leak_test.html and leak_test.json.

    RIG needs `blocking_valves`, as the simulated rig `locked` and the emulated `emulated_locked`
    have them. A rig on hardware is armed and homed before, and its ram brought to mid stroke; who
    watches the live stream sees it, and may stop it. The rig is left safe, its blocking valves
    open. Exit code 0 no leak, 1 a leak, 2 bad input, 3 stopped, tripped, or a chamber did not keep
    its pressure.
    """
    rig, assumed = load_rig(reference), load_model(model)
    if rig.blocking_valves is None:
        raise click.BadParameter(without_valves(rig), param_hint="RIG")
    connected = rig.backend == "hardware"
    if connected and seed is not None:
        raise click.BadParameter(f"{rig.name} is not simulated; leave it out", param_hint="--seed")
    if not connected and profile is not None:
        hint = "--stream"
        raise click.BadParameter(
            f"{rig.name} is simulated, and not streamed; leave it out", param_hint=hint
        )
    settings = stream_of(profile, paced=connected)
    begun = datetime.now(UTC)
    directory = folder or default_directory(f"leak-test-{rig.name}", begun)
    existed = directory.exists()
    make_empty(directory)
    screen, stop = Screen(), StopFlag()
    screen.quiet = as_json
    lost = "; nothing was written"
    with (
        ending(EXIT_STOPPED, LeakTestError, StoppedError, after=lost),
        failures_reported(),
        stop_on_signals(stop),
    ):
        try:
            if connected:
                test = _on_hardware(rig, assumed, directory, stop, screen, settings)
            else:
                test = run_leak_test(
                    rig, assumed.parameters, SimulatedLockable(rig, seed or 0),
                    lambda number, _: screen.print(_soaked(number)), lambda: stop.reason,
                )  # fmt: skip
        except BaseException:
            # A rig that tripped has left a report there.
            if not existed:
                with suppress(OSError):
                    directory.rmdir()
            raise
    figures = leak_test_figures(test)
    text = json.dumps(figures, indent=1, allow_nan=False)
    replace_text(directory / "leak_test.json", text + "\n")
    page = directory / "leak_test.html"
    replace_text(page, leak_test_page(test, f"{begun:%Y-%m-%d %H:%M}"))
    if as_json:
        click.echo(json.dumps(figures, allow_nan=False))
    screen.print_table(HEADINGS, leak_rows(test), right=HEADINGS[2:5])
    for sentence in (*leak_sentences(test), f"page: {page}"):
        screen.print(sentence, soft_wrap=True)
    return EXIT_LEAK if test.leaks else 0


def _on_hardware(
    rig: Rig,
    assumed: Model,
    directory: Path,
    stop: StopFlag,
    screen: Screen,
    settings: StreamSettings | None,
) -> LeakTest:
    """Test a rig on hardware, which is seen and may be stopped on the live stream."""
    compile_for(Needs(rig, DEFAULT_FILTER), WITHOUT_TESTS, screen.print, stop)
    screen.print(could_see(rig, assumed))
    streamed = session_streamed(settings, rig, directory, stop, "leak test", screen.print)
    with streamed as (say, onlooker):

        def on_soak(number: int, _: Soak) -> None:
            say(_soaked(number))

        return run_connected_leak_test(rig, assumed, directory, stop, say, onlooker, on_soak)


def _soaked(number: int) -> str:
    return f"soak {number} of 3"


def without_valves(rig: Rig) -> str:
    """Return why a rig without blocking valves cannot be tested, and what it can do instead."""
    return (
        f"{rig.name} has no blocking valves (`blocking_valves` in its file), and a servovalve at "
        "null passes far more than what this test looks for; use a motion (`rig run`) instead: of "
        "those studied a sine is best, of which no detector finds less than 0.0090 L/min in 10 s "
        "or 0.0056 in 60 s, and this one finds 0.042 in 10 s and 0.028 in 60 s (docs/leak_test.md)"
    )
