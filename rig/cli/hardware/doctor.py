"""`rig doctor` shows what this machine grants to a rig, and a remedy for what it does not."""

import json
from pathlib import Path
from typing import Any, Final

import click
from rich.text import Text

from rig.cli.application import EXIT_CRASHED
from rig.cli.option_types import Range
from rig.cli.screen import Screen
from rig.configuration import load_rig
from rig.io import DriverError, DriverSpec, LoopSettings, exclusive
from rig.loop import Grant, RealTime, StageTimes, wakeup_lateness

from .machine import Finding, machine

STYLES: Final = {"good": "green", "weak": "yellow", "bad": "bold red"}

_LATE: Final = 2e-4
"""Limit in s of the 99th percentile of the wake-up lateness; above it a 1 kHz loop is pressed."""
_MISSED: Final = 5e-3
"""Share of missed ticks above which the gaps in recordings matter."""


@click.command()
@click.option("--rig", "reference", metavar="RIG", help="Probe this rig's drivers too: open only.")
@click.option(
    "--seconds",
    type=Range(0.01, 3600.0),
    default=5.0,
    show_default=True,
    help="How long the idle loop is measured.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of the table.")
def command(reference: str | None, seconds: float, as_json: bool) -> int:
    """Show what this machine grants to a rig's loop, and the remedy for what it does not.

    Nothing moves; devices that another program on this machine drives are left alone. Exit code:
    0 the loop would run, 1 something that the loop needs is bad, 2 bad input.
    """
    rig = load_rig(reference) if reference is not None else None
    loop = rig.loop if rig is not None else LoopSettings()
    # Compile before the priority is raised: a compiler at the loop's priority would delay others.
    wakeup_lateness(1.0 / loop.rate, 1)
    with RealTime(loop.cpu, loop.priority) as real_time:
        lateness = wakeup_lateness(1.0 / loop.rate, max(1, round(seconds * loop.rate)))
    stage = StageTimes()
    stage.take(lateness)
    timing = {"ticks": lateness.size, "missed": lateness.size - stage.count, **stage.summary()}
    findings = [
        *map(_granted, real_time.grants),
        *machine(Path.cwd()),
        *(map(_opened, rig.drivers) if rig is not None else ()),
        _judged(timing, loop),
    ]
    if as_json:
        listed = [finding._asdict() for finding in findings]
        click.echo(json.dumps({"findings": listed, "loop": timing}))
    else:
        rows = (
            (each.subject, Text(each.found, STYLES[each.grade]), each.remedy) for each in findings
        )
        Screen().print_table(("", "found", "remedy"), rows)
    return EXIT_CRASHED if any(finding.grade == "bad" for finding in findings) else 0


def _granted(grant: Grant) -> Finding:
    if grant.granted:
        return Finding(grant.name, f"granted: {grant.why}")
    return Finding(grant.name, f"refused: {grant.why}", "weak", grant.remedy)


def _opened(spec: DriverSpec) -> Finding:
    """Open and close a driver; return a finding on whether the expected device answers."""
    subject = f"driver {spec.name}"
    try:
        driver = spec.create()
        try:
            with exclusive([spec]):
                driver.open()
        finally:
            driver.close()
    except DriverError as error:
        found = f"{error.channel}: {error.state}" if error.channel else error.state
        return Finding(subject, found, "bad", error.action)
    return Finding(subject, f"{spec.type} answers, {spec.kind}, {spec.rate_hz:g} Hz")


def _judged(timing: dict[str, Any], loop: LoopSettings) -> Finding:
    missed = timing["missed"] / timing["ticks"]
    p50, p99, worst = (1e6 * timing[key] for key in ("p50_s", "p99_s", "max_s"))
    found = (
        f"{timing['ticks']} ticks at {loop.rate:g} Hz: wakes {p50:.0f} us late (p50), {p99:.0f} us "
        f"(p99), {worst:.0f} us at most; {missed:.2%} missed"
    )
    if timing["p99_s"] <= _LATE and missed <= _MISSED:
        return Finding("idle loop", found)
    remedy = "heed the remedies above; close other programs, or use another machine"
    return Finding("idle loop", found, "weak", remedy)
