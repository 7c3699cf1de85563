"""`rig jog` moves a rig by hand: commands from the terminal and from the operator's page."""

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final

import click

from estimator.filters import DEFAULT_FILTER
from rig.cli.live_stream import manual_streamed, stream_of
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import load_model, load_rig
from rig.control_socket import own_name
from rig.runner import StopFlag, stop_on_signals
from rig.runner.campaign import WITHOUT_TESTS, Needs, compile_for
from rig.runner.run_folder import default_directory
from rig.supervisor import HELP, ConnectedRig, Inbox, Manual, ManualError, parse

_BY_ITSELF: Final = ("by", "to", "generator", "bypass")
"""Commands before which, given on the command line, pump and homing are asked for."""
_KEYS: Final = "hold a key to move, q or Enter to leave"


@click.command(context_settings={"ignore_unknown_options": True}, epilog="\b\nCommands:\n" + HELP)
@click.argument("reference", metavar="RIG")
@click.argument("words", metavar="[COMMAND]...", nargs=-1)
@click.option("--speed", help="Speed of the command `by` or `to`, such as 20mm/s.")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@STREAMED
def command(
    reference: str, words: tuple[str, ...], speed: str | None, model: str, profile: str | None
) -> int:
    """Move a hardware rig by hand.

    Without COMMAND it reads commands from the terminal, one a line, until `end`. With COMMAND it
    loads the pump, homes the rig, carries that command out and leaves. Who watches the live stream
    sees it and may stop it; who has control of the operator's page may command it too. However it
    ends, the valve is left at null, the bypasses shut and the pump unloaded.
    Exit code: 0 ended as asked for, 2 bad input, 3 stopped or tripped.
    """
    rig, assumed = load_rig(reference), load_model(model)
    if rig.backend != "hardware":
        raise click.BadParameter(
            f"{rig.name} is simulated, and has nothing to move by hand; give a rig with "
            "`backend: hardware`, such as emulated",
            param_hint="RIG",
        )
    lines = _lines(words, speed)
    settings = stream_of(profile, paced=True)
    directory = default_directory(f"jog-{rig.name}", datetime.now(UTC))
    directory.mkdir(parents=True)
    stop, screen, inbox = StopFlag(), Screen(), Inbox()
    try:
        with failures_reported(), stop_on_signals(stop):
            compile_for(Needs(rig, DEFAULT_FILTER), WITHOUT_TESTS, screen.print, stop)
            streamed = manual_streamed(settings, rig, directory, stop, inbox, screen.print)
            with streamed as (say, onlooker):
                connected = ConnectedRig(
                    rig, DEFAULT_FILTER, assumed, directory, stop, say, onlooker
                )
                return _move(
                    connected, Manual(connected, inbox, say, onlooker.moves), inbox, say, lines
                )
    finally:
        # The folder is empty, and is removed, unless the rig tripped.
        with contextlib.suppress(OSError):
            directory.rmdir()


def _lines(words: tuple[str, ...], speed: str | None) -> list[str]:
    """Return the commands of a command line, with those that must come before; [] without any."""
    if not words:
        if speed is not None:
            raise click.BadParameter("needs a command `by` or `to`", param_hint="--speed")
        return []
    line = " ".join((*words, *(("speed", speed) if speed is not None else ())))
    try:
        asked = parse(line)
    except ManualError as error:
        raise click.BadParameter(str(error), param_hint="COMMAND") from None
    if asked.what in ("hold", "beat", "stop", "end"):
        raise click.BadParameter(
            f"{asked.what} makes sense within a session only; leave COMMAND out, and type it there",
            param_hint="COMMAND",
        )
    if asked.what in _BY_ITSELF:
        return ["pump high", "home", line]
    return ["pump high", line] if asked.what == "home" else [line]


def _move(
    connected: ConnectedRig,
    manual: Manual,
    inbox: Inbox,
    say: Callable[[str], None],
    lines: list[str],
) -> int:
    """Connect the rig, carry commands out, and leave it safe; return the exit code."""
    connected.connect()
    refused: list[str] = []
    try:
        done = threading.Event()

        def one_by_one() -> None:
            for line in lines:
                refusal = inbox.ask(line, own_name(), remote=False)
                while refusal and inbox.busy and not done.wait(0.1):
                    refusal = inbox.ask(line, own_name(), remote=False)
                if refusal:
                    refused.append(refusal)
                    break
            done.set()

        if lines:
            threading.Thread(target=one_by_one, daemon=True).start()
            generates = lines[-1].startswith(("generator", "bypass"))
            if generates:
                say("it goes on until Ctrl-C, or a stop by anybody")
            manual.run(lambda: done.is_set() and manual.rests and not inbox.busy
                       and (not generates or bool(refused)))  # fmt: skip
        else:
            say("commands, one a line; `help` shows them, `end` leaves")
            typed = threading.Thread(target=_typed, args=(inbox, say), daemon=True)
            typed.start()
            manual.run(lambda: not typed.is_alive() and manual.rests)
    finally:
        connected.leave()
    for refusal in refused:
        click.echo(refusal, err=True)
    return 2 if refused else 0


def _typed(inbox: Inbox, say: Callable[[str], None]) -> None:
    """Hand over the lines of stdin until it ends, which ends the session."""
    for text in sys.stdin:
        line = text.strip()
        if not line:
            continue
        if line.startswith("hold ") and sys.stdin.isatty():
            say(_KEYS)
            say(_held_keys(line, inbox) or "let go")
            continue
        refusal = inbox.ask(line, own_name(), remote=False)
        while refusal and inbox.busy and not sys.stdin.isatty():
            # Lines of a file or pipe wait for their turn; a person is told at once.
            threading.Event().wait(0.1)
            refusal = inbox.ask(line, own_name(), remote=False)
        if refusal:
            say(refusal)
        if line == "end" and not refusal:
            return
    inbox.ask("stop", own_name(), remote=False)
    inbox.ask("end", own_name(), remote=False)


def _held_keys(line: str, inbox: Inbox) -> str:
    """Move while a key repeats itself, by the command `line`, until q or Enter, or a refusal.

    Return why it was refused; "" if it was not.

    Each repetition of the key is a heartbeat. A terminal repeats a key after a delay of its own,
    before which the ram comes to rest once.
    """
    keyboard = sys.stdin.fileno()
    before, refusal = termios.tcgetattr(keyboard), ""
    try:
        tty.setcbreak(keyboard)
        while not refusal:
            ready, _, _ = select.select([keyboard], [], [], 1.0)
            if not ready:
                continue
            keys = os.read(keyboard, 64)
            if not keys or any(key in b"qQ\r\n\x04" for key in keys):
                break
            refusal = inbox.ask(line, own_name(), remote=False)
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
        inbox.ask("stop", own_name(), remote=False)
    return refusal
