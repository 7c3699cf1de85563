"""`rig monitor` shows the live streams of rigs, as text for a terminal, for a log, or as JSON."""

import json
import time
from collections.abc import Iterator, Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any, Final

import click
from rich.console import Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from rig.channels import LITRES_PER_MINUTE, SHOWN
from rig.cli.application import EXIT_BAD_INPUT, EXIT_STOPPED, ending
from rig.cli.option_types import text
from rig.cli.screen import Screen
from rig.configuration import load_stream
from rig.control_socket import own_name
from rig.stream import COMMANDS, CommandName, Snapshot

from .following import endpoints, follows_streams

if TYPE_CHECKING:
    from rig.stream import StreamClient

SCREEN_S: Final = 0.1
LOG_S: Final = 1.0
EXIT_DEAD: Final = 1
ABORT_S: Final = 10.0
"""Time in s for which an abort that nobody hears is sent again and again."""
EVENTS: Final = 6
STYLES: Final = {"live": "green", "ended": "dim", "dead": "bold red", "unheard": "dim"}
_US: Final = 1e6


@click.command()
@click.option(
    "--rig", "rig_id", default="*", type=text, metavar="ID", help="One rig; all if not given."
)
@follows_streams
@click.option("--once", is_flag=True, help="Show what there is, once, and end; 1 if nothing lives.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a rig and line.")
@click.option(
    "--wait", "wait_s", default=5.0, metavar="SECONDS", help="How long --once waits for a rig."
)
@click.option(
    "--send", "order", type=click.Choice(COMMANDS),
    help="Send a command instead; see docs/stream.md for each. 1 if it is not obeyed.",
)  # fmt: skip
@click.option("--text", default="", type=text, help="A remark that is recorded with the command.")
@click.option("--test", default="", type=text, metavar="NAME", help="The test to skip or to retry.")
def command(
    rig_id: str,
    connect: tuple[str, ...],
    profile: str,
    once: bool,
    as_json: bool,
    wait_s: float,
    order: CommandName | None,
    text: str,
    test: str,
) -> int:
    """Watch rigs that run, live: rates, lateness, pressures, residual and threshold, verdict.

    On a terminal the screen is updated until Ctrl-C; elsewhere a line is written each second for
    each rig. A stream that has died is shown as dead, with the time since its last message.
    """
    settings = load_stream(profile)
    where = endpoints(connect)
    from rig.stream import KeyFileError, StreamClient, StreamError, UnknownRigError

    try:
        with (
            ending(EXIT_BAD_INPUT, KeyFileError, StreamError, UnknownRigError),
            StreamClient(settings, where, rig=rig_id) as client,
        ):
            if once or order:
                _await(client, wait_s)
            if order is not None:
                rig = None if rig_id == "*" else rig_id
                if order == "abort":
                    # A rig that is being connected, or that changes hands, is heard in seconds.
                    answer = client.send_until_heard(order, rig, text, ABORT_S, own_name())
                else:
                    answer = client.send(order, rig, text, test=test, person=own_name())
                click.echo(f"{order}: {'obeyed' if answer.accepted else answer.reason}")
                return 0 if answer.accepted else EXIT_DEAD
            if not once:
                return _follow(client, as_json)
            found = _write(client, as_json)
            if not found:
                click.echo("no rig is heard of; is one running, and with a stream?", err=True)
            return 0 if any(snapshot.alive for snapshot in found) else EXIT_DEAD
    except BrokenPipeError:
        return EXIT_STOPPED


def _await(client: "StreamClient", wait_s: float) -> None:
    """Wait until a rig is alive and has sent its health; give up after `wait_s`, in s.

    Each such rig is then asked for its messages of the last second, which the client stores.
    """
    until = time.monotonic() + wait_s
    while time.monotonic() < until:
        living = [shot.rig for shot in client.snapshots() if shot.alive and shot.health]
        for rig in living:
            client.history(1.0, rig)
        if living:
            return
        time.sleep(SCREEN_S)


def _write(client: "StreamClient", as_json: bool) -> list[Snapshot]:
    """Write a line for each rig, and return the rigs' snapshots."""
    found = client.snapshots()
    for shot in found:
        click.echo(json.dumps(document(shot), allow_nan=False) if as_json else line(shot))
    return found


def _follow(client: "StreamClient", as_json: bool) -> int:
    console = Screen()
    try:
        if console.is_terminal and not as_json:
            with Live(console=console, screen=True, auto_refresh=False) as live:
                while True:
                    shown = [screen(snapshot) for snapshot in client.snapshots()]
                    live.update(Group(*(shown or ["waiting for a rig ..."])), refresh=True)
                    time.sleep(SCREEN_S)
        while True:
            _write(client, as_json)
            time.sleep(LOG_S)
    except KeyboardInterrupt:
        return 0


def document(snapshot: Snapshot) -> dict[str, Any]:
    """Return a snapshot as plain values for JSON, in SI; NaN and infinity become None.

    Gaps and past verdicts are left out, and so are the messages' version, session and sequence.
    """
    told = ("rig", "alive", "life", "age_s", "session", "restarts", "rate_hz")
    return {
        **{name: getattr(snapshot, name) for name in told},
        "time_s": _known(snapshot.time_s),
        "latest": {name: _known(value) for name, value in snapshot.latest.items()},
        "units": dict(zip(snapshot.names, snapshot.units, strict=True)),
        "missing": dict(snapshot.missing),
        "proven": snapshot.proven,
        "refused": snapshot.refused,
        **{
            kind: _content(getattr(snapshot, kind))
            for kind in ("state", "campaign", "progress", "decision", "health")
        },
        "events": [_content(event) for event in snapshot.events],
    }


def line(snapshot: Snapshot) -> str:
    """Return a snapshot on one line, for a log: life, test, and the values that are known."""
    progress = snapshot.progress
    parts = [f"{snapshot.rig}: {_life(snapshot)}"]
    if progress:
        number, count = (_number(progress.get(key), "g") for key in ("number", "count"))
        parts.append(f"[{number}/{count}] {progress.get('name', '')}")
    if isfinite(snapshot.time_s):
        parts.append(f"{snapshot.time_s:.1f} s")
    parts += [f"{name} {value}" for name, value in _figures(snapshot)]
    return ", ".join(parts)


def screen(snapshot: Snapshot) -> RenderableType:
    """Return a snapshot as a panel of several lines, for a terminal."""
    figures = Table.grid(padding=(0, 2))
    for name, value in _figures(snapshot):
        figures.add_row(Text(name, style="dim"), Text(value))
    events = map(_event, snapshot.events[-EVENTS:])
    style = STYLES[snapshot.life]
    title = Text(f"{snapshot.rig}: {_life(snapshot)}", style=style)
    return Panel(Group(_progress(snapshot), figures, Text(), *events), title=title)


def _life(snapshot: Snapshot) -> str:
    if snapshot.age_s is None:
        return "nothing heard yet"
    if snapshot.life == "ended":
        return f"ended {snapshot.age_s:.1f} s ago; what is shown is what was"
    if not snapshot.alive:
        return f"DEAD for {snapshot.age_s:.1f} s; what is shown is what was"
    return f"live, {snapshot.rate_hz:.0f} samples a second"


def _progress(snapshot: Snapshot) -> Text:
    progress, campaign = snapshot.progress, snapshot.campaign
    person = campaign.get("begun_by", "")
    by = f", begun by {person}" if person else ""
    name = campaign.get("activity") or campaign.get("name", "")
    if not progress:
        if campaign.get("status") == "idle":
            return Text(name)
        return Text(f"{name} {campaign.get('status', '')}{by}" if name else "no campaign")
    return Text(
        f"{name} {campaign.get('status', '')}{by}: "
        f"test {_number(progress.get('number'), 'g')} of {_number(progress.get('count'), 'g')}, "
        f"{progress.get('name', '')}, {_number(progress.get('time_s'), '.1f')} of "
        f"{_number(progress.get('duration_s'), 'g')} s"
    )


def _figures(snapshot: Snapshot) -> Iterator[tuple[str, str]]:
    """Yield name and text of every value that is to be shown, leaving out unknown ones."""
    latest, health, decision = snapshot.latest, snapshot.health, snapshot.decision
    if snapshot.state:
        yield "state", str(snapshot.state.get("state", ""))
    for channel, (title, unit, _, on_monitor) in SHOWN:
        value = latest.get(channel, float("nan"))
        if on_monitor and isfinite(value):
            yield title, f"{unit.shown(value):.2f} {unit.text}"
    if decision:
        yield "verdict", _verdict(decision)
        statistic, threshold = decision.get("statistic"), decision.get("threshold")
        yield "residual", f"{_number(statistic, '.2f')} of {_number(threshold, '.2f')}"
    for stage, words in (("wakeup", "lateness"), ("exchange", "exchange")):
        timed = health.get("timing", {}).get(stage)
        if timed:
            named = (("p50", "p50_s"), ("p99", "p99_s"), ("most", "max_s"))
            times = (f"{name} {_number(timed.get(key), '.0f', _US)} us" for name, key in named)
            yield words, ", ".join(times)
    if health.get("missed") or health.get("exchange_errors"):
        missed, failed = (_number(health.get(key), "g") for key in ("missed", "exchange_errors"))
        yield "ticks missed", f"{missed}, exchanges failed {failed}"
    if health.get("sentence"):
        yield str(health.get("action", "")), str(health["sentence"])
    for trip in health.get("trips", {}).get("first_out", [])[:1]:
        by, sentence, remedy = (trip.get(key, "") for key in ("by", "sentence", "remedy"))
        yield "TRIPPED", f"by {by}: {sentence}; {remedy}"
    if snapshot.missing:
        yield "missing", ", ".join(f"{n} {kind}" for kind, n in sorted(snapshot.missing.items()))
    if snapshot.refused:
        yield (
            "refused",
            f"{snapshot.refused} that are no messages of it, the last: {snapshot.refusal}",
        )


def _verdict(decision: Mapping[str, Any]) -> str:
    text = str(decision.get("verdict", ""))
    chance = decision.get("probabilities", {}).get(text)
    flow = decision.get("leak_m3_per_s")
    text += "" if chance is None else f" {100.0 * chance:.0f} %"
    text += "" if flow is None else f", {LITRES_PER_MINUTE.shown(flow):.3f} L/min"
    if growth := decision.get("growth"):
        text += f", {growth}"
    comes_and_goes = decision.get("intermittent") is True
    if comes_and_goes:
        share = _number(decision.get("duty"), ".0f", 100.0)
        text += f", comes and goes, open {share} % of the time"
    ended_s = decision.get("ended_s")
    if isinstance(ended_s, int | float):
        # The words are those of the report (rig.runner.outcomes), which takes long to import.
        text += f", {'last open until' if comes_and_goes else 'gone again at'} {ended_s:.1f} s"
    return text


def _event(event: Mapping[str, Any]) -> Text:
    at, kind = event.get("time_s"), event.get("kind", "")
    words = f"{'' if at is None else f'{at:.1f} s '}{kind}: {event.get('text', '')}"
    return Text(words, style="bold red" if kind in ("trip", "error", "refused") else "dim")


def _number(value: Any, form: str, factor: float = 1.0) -> str:
    return format(factor * value, form) if isinstance(value, int | float) else "-"


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


def _content(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a message without the fields of its header."""
    header = ("version", "session", "sequence")
    return {name: value for name, value in content.items() if name not in header}
