"""`rig doctor` shows what this machine grants to a rig, and a remedy for what it does not.

The checks look at kernel, clock, processors, ports and disk.
"""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import click
from rich.text import Text

from rig.cli.application import EXIT_CRASHED
from rig.cli.option_types import Range
from rig.cli.screen import Screen
from rig.configuration import Rig, load_rig
from rig.io import DriverError, DriverSpec, LoopSettings, exclusive
from rig.loop import Grant, RealTime, StageTimes, wakeup_lateness
from rig.supervisor import word_of_station

Grade = Literal["good", "weak", "bad"]

_CAN: Final = "280"
"""The type of a CAN interface in /sys/class/net: ARPHRD_CAN of linux/if_arp.h."""

_CPU: Final = "sys/devices/system/cpu"
_CLOCK: Final = "sys/devices/system/clocksource/clocksource0/current_clocksource"
_FAST_CLOCKS: Final = ("tsc", "arch_sys_counter", "kvm-clock")
"""Clocks that are read without a system call; any other clock costs microseconds in each tick."""

_RECORDED_PER_HOUR: Final = 2e9
"""Bytes that an hour of recording takes, rounded up: 50 channels of 8 bytes at 1 kHz, framed."""
_NEEDED_PER_S: Final = 10 * _RECORDED_PER_HOUR / 3600.0
_SAMPLE_BYTES: Final = 16 << 20


class Finding(NamedTuple):
    """One property of the machine that was checked, with a grade and a remedy.

    Attributes:
        subject: the property, such as "kernel".
        found: its value, in words.
        grade: good, weak (the rig runs, with more jitter or less choice), or bad (it would not
            run).
        remedy: what the user should do; empty if nothing is to be done.
    """

    subject: str
    found: str
    grade: Grade = "good"
    remedy: str = ""


def machine(recordings: Path, root: Path = Path("/")) -> Iterator[Finding]:
    """Yield a finding for each property of this machine that matters to any rig, good ones too.

    Args:
        recordings: existing folder in which runs would be recorded; 16 MB are written there.
        root: folder that holds proc, sys and dev.
    """
    checks = (_kernel, _clock, _processors, _governor, _throttling, _serial_ports, _can_interfaces)
    for check in checks:
        yield check(root)
    yield _cyclictest()
    yield _disk_space(recordings)
    yield _disk_speed(recordings)


def _text(path: Path) -> str:
    """Return the text of a file of the kernel, stripped; "" if it cannot be read."""
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _weak_unless(good: object, subject: str, found: str, remedy: str) -> Finding:
    return Finding(subject, found) if good else Finding(subject, found, "weak", remedy)


def _kernel(root: Path) -> Finding:
    bounded = _text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in os.uname().version
    found = f"{os.uname().release}, {'' if bounded else 'not '}PREEMPT_RT"
    remedy = "install a kernel with PREEMPT_RT: it bounds the latest ticks"
    return _weak_unless(bounded, "kernel", found, remedy)


def _clock(root: Path) -> Finding:
    source = _text(root / _CLOCK) or "unknown"
    remedy = "boot with tsc=reliable, if the processor's counter is"
    return _weak_unless(source in _FAST_CLOCKS, "clock source", source, remedy)


def _processors(root: Path) -> Finding:
    usable, isolated = len(os.sched_getaffinity(0)), _text(root / _CPU / "isolated")
    if usable == 1:
        remedy = "give it two: the loop should share its own with nobody"
        return Finding("processors", "1", "weak", remedy)
    found = f"{usable}, isolated {isolated}" if isolated else f"{usable}, none isolated"
    remedy = "boot with isolcpus=N nohz_full=N, and write `loop: {cpu: N}` in the rig file"
    return _weak_unless(isolated, "processors", found, remedy)


def _governor(root: Path) -> Finding:
    paths = sorted((root / _CPU).glob("cpu[0-9]*/cpufreq/scaling_governor"))
    governors = sorted({_text(path) for path in paths})
    found = ", ".join(governors) if governors else "none: the clock rate is not ours to set"
    remedy = "cpupower frequency-set --governor performance"
    best = governors in ([], ["performance"])
    return _weak_unless(best, "frequency governor", found, remedy)


def _throttling(root: Path) -> Finding:
    runtime = _text(root / "proc/sys/kernel/sched_rt_runtime_us")
    period = _text(root / "proc/sys/kernel/sched_rt_period_us")
    if runtime == "-1" or not runtime:
        return Finding("real-time throttling", "off")
    # A loop that sleeps in every tick stays far below it.
    return Finding("real-time throttling", f"{runtime} us of every {period} us, which suffices")


def _serial_ports(root: Path) -> Finding:
    # ttyS ports are left out, as every PC lists them whether it has them or not.
    ports = [str(port) for kind in ("ttyUSB", "ttyACM") for port in (root / "dev").glob(f"{kind}*")]
    shut = [port for port in ports if not os.access(port, os.R_OK | os.W_OK)]
    found = ", ".join(sorted(ports)) or "no USB adapter"
    found = f"no access to {', '.join(shut)}" if shut else found
    remedy = "add yourself to the group dialout and log in again"
    return _weak_unless(not shut, "serial ports", found, remedy)


def _can_interfaces(root: Path) -> Finding:
    types = (root / "sys/class/net").glob("*/type")
    states = {path.parent.name: _text(path.parent / "operstate") for path in types
              if _text(path) == _CAN}  # fmt: skip
    found = ", ".join(f"{name} {state}" for name, state in sorted(states.items())) or "none"
    down = sorted(name for name, state in states.items() if state == "down")
    remedy = f"ip link set {next(iter(down), '')} up type can bitrate 500000"
    return _weak_unless(not down, "CAN interfaces", found, remedy)


def _cyclictest() -> Finding:
    path = shutil.which("cyclictest")
    remedy = "install rt-tests: make bench-loop compares the loop with it"
    return _weak_unless(path, "cyclictest", path or "not found", remedy)


def _disk_space(folder: Path) -> Finding:
    hours = shutil.disk_usage(folder).free / _RECORDED_PER_HOUR
    found = f"{hours:.0f} h of recordings in {folder}"
    if hours >= 1.0:
        return Finding("disk space", found)
    grade: Grade = "weak" if hours > 0.1 else "bad"
    return Finding("disk space", found, grade, "free space, or record elsewhere with --out")


def _disk_speed(folder: Path) -> Finding:
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            started = time.perf_counter()
            file.write(bytes(_SAMPLE_BYTES))
            file.flush()
            os.fsync(file.fileno())
            speed = _SAMPLE_BYTES / (time.perf_counter() - started)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return Finding("disk speed", f"{folder}: {reason}", "bad", "give another folder with --out")
    remedy = "record to a local disk with --out"
    return _weak_unless(speed >= _NEEDED_PER_S, "disk speed", f"{speed / 1e6:.0f} MB/s", remedy)


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
        *(_devices(rig) if rig is not None else ()),
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


def _devices(rig: Rig) -> Iterator[Finding]:
    """Yield a finding on the rig's station, if there is one, and on each of its drivers.

    Devices that the station has are not opened.
    """
    try:
        station = word_of_station(rig)
    except DriverError as error:
        yield Finding("station", error.state, "bad", error.action)
        station = None
    if station is None or station["state"] == "no devices":
        if station is not None:
            remedy = "see the findings on the drivers below"
            yield Finding("station", f"process {station['pid']}, {station['text']}", "weak", remedy)
        yield from map(_opened, rig.drivers)
        return
    yield Finding(
        "station", f"process {station['pid']} since {station['since']}: {station['text']}"
    )
    for spec in rig.drivers:
        yield Finding(f"driver {spec.name}", "not opened: the station has it, or who it lent it to")


def _opened(spec: DriverSpec) -> Finding:
    """Open and close a driver; return a finding on whether the expected device answers."""
    subject = f"driver {spec.name}"
    try:
        with closing(spec.create()) as driver, exclusive([spec]):
            driver.open()
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
    remedy = "heed the remedies above; close other programs, or use another machine"
    good = timing["p99_s"] <= _LATE and missed <= _MISSED
    return _weak_unless(good, "idle loop", found, remedy)
