"""The `rig` command finds its subcommand and turns every error into a message and an exit code."""

import errno
import gc
import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Final, NoReturn

import click

import rig
from rig.plain_output import plain_output

EXIT_CRASHED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_STOPPED: Final = 3

_PATH_ERRORS: Final = (
    errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR,
    errno.EISDIR, errno.ENXIO,
)  # fmt: skip
"""Errors of the system for a path that has a name of over 255 bytes or a loop of links, that this
user may not use, that is on a disk which is read only, or that is another kind of file."""
_NO_SPACE: Final = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a disk that is full, or of which this user may have no more."""
_LONGEST_SHOWN: Final = 100
"""Most characters that a message shows of a path that cannot be one."""

COMMANDS: Final = {
    "run": ("campaigns.run", "Run a fault-injection campaign and write its report."),
    "control": (
        "campaigns.control",
        "Pause, resume, abort, skip or retry in a running campaign; take notes.",
    ),
    "monitor": ("live.monitor", "Watch rigs that run, live, in the terminal."),
    "console": ("live.console", "Serve the operator's web page: watch, start, hold, stop."),
    "accounts": ("live.accounts", "Say who may log in to the console, and what each may do."),
    "queue": ("live.queue", "Edit the queue of campaigns that the console starts."),
    "router": ("live.router", "Route the live streams of many rigs."),
    "schedule": ("campaigns.schedule", "Run campaigns at times or intervals, unattended."),
    "runs": ("campaigns.runs", "Find, show, compare and prune past runs."),
    "sweep": ("models.sweep", "Run thousands of cases drawn at random, on all cores or a cluster."),
    "emulate": ("hardware.emulate", "Serve an emulated rig where drivers look for a real one."),
    "check": ("campaigns.check", "Validate configurations; dry-run campaigns."),
    "replay": ("recordings.replay", "Run filter and detector over recordings."),
    "baseline": ("recordings.baseline", "Learn from healthy recordings what is normal for a rig."),
    "gap": ("models.gap", "Find where a model is wrong, name what it lacks, add it."),
    "identify": (
        "models.identify",
        "Identify a rig's friction, by an experiment or from recordings.",
    ),
    "export": ("recordings.export", "Write a recording to another format."),
    "recover": ("recordings.recover", "Save what is left of a cut or damaged recording."),
    "station": (
        "hardware.station",
        "Own a rig: read it, show it, lend it to what drives it.",
    ),
    "home": ("hardware.home", "Home a rig's encoder, to see that it can be homed."),
    "jog": ("hardware.jog", "Move a rig by hand: jog, hold-to-run, generator, bypasses, pump."),
    "counters": ("hardware.counters", "Show what a rig has done: cycles, metres, hours."),
    "commission": (
        "hardware.commission",
        "Find how a new rig is wired and what it is like; write it into its file.",
    ),
    "leak-test": (
        "hardware.leak_test",
        "Lock a cylinder by its blocking valves, and measure its leaks.",
    ),
    "calibrate": ("hardware.calibrate", "Measure a rig's needle valves with its flow meters."),
    "tune": ("models.tune", "Tune a rig's position loop by an experiment."),
    "doctor": ("hardware.doctor", "Show what this machine grants to a rig, and the remedies."),
    "schema": ("schema", "Write the JSON schema by which an editor completes a file's keys."),
    "init": ("init", "Copy the shipped rigs, models, campaigns, sweeps and maps to edit."),
}
"""By subcommand: the module of this package that holds its `command`, and a line of help."""


@contextmanager
def _without_collector() -> Iterator[None]:
    """Switch the garbage collector off while modules are imported; it never looks at them later.

    Modules make a million objects that stay to the end. The collector would look through them again
    and again, which takes an eighth of the time of the imports and as much later on.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


class LazyGroup(click.Group):
    """A group that imports a subcommand only when it is called, not when it is listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the subcommand of this name, imported now; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        module = f"{__package__}.{COMMANDS[cmd_name][0]}"
        if module not in sys.modules:
            with _without_collector():
                import_module(module)
        command: click.Command = sys.modules[module].command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(rig.__version__, prog_name="rig")
def application() -> None:
    """Drive a servo-hydraulic actuator test rig: inject faults, find them, report them."""


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line, and exit with a code.

    The exit code is 0 if all went as expected, 1 if a test failed or this program crashed, 2 if
    the input was bad (every problem is then on stderr), and 3 if it was stopped before its end, by
    somebody or because the system has no files, memory or disk space left.

    Args:
        arguments: the arguments of the command line, without the program's name; if None, those of
            this process.
    """
    # A command whose output is closed (`>&-`) still writes its results to their folder.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115 (kept until the exit)
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    # A character that the terminal's encoding lacks is replaced and does not end the command.
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
    warnings.showwarning = _show_warning
    with plain_output():
        code = _run(arguments)
    sys.exit(code)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        code = application.main(arguments, prog_name="rig", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except click.Abort:
        click.echo("stopped", err=True)
        return EXIT_STOPPED
    except click.ClickException as error:
        error.show()
        return EXIT_BAD_INPUT
    except Exception as error:
        if is_bad_input(error):
            click.echo(str(error), err=True)
            return EXIT_BAD_INPUT
        if (problem := _unusable_path(error)) is not None:
            click.echo(problem, err=True)
            return EXIT_BAD_INPUT
        if (refused := _refused_by_the_system(error)) is not None:
            click.echo(f"rig: {refused}", err=True)
            return EXIT_STOPPED
        kept = "its traceback could not be kept"
        with suppress(OSError):
            kept = f"traceback in {_keep_traceback()}"
        click.echo(f"rig: {one_line(error)}; {kept}", err=True)
        return EXIT_CRASHED


def is_bad_input(error: BaseException) -> bool:
    """Return whether an error is a ValueError that lists problems of the input, rather than a bug.

    ConfigError, RecordingError, RequestError, RunError and others do, by an attribute `problems`
    that is not empty. Their classes are not imported, as `rig --help` would take longer by 0.5 s.
    """
    return isinstance(error, ValueError) and bool(getattr(error, "problems", None))


def _unusable_path(error: Exception) -> str | None:
    """Return what is wrong with a path that cannot be used; None if that is not the error.

    Whether a path exists is asked in many places, and the system's answer may be that the path
    itself is wrong, or that a folder above it may not be entered.
    """
    if isinstance(error, OSError) and error.errno in _PATH_ERRORS and error.filename is not None:
        path = os.fsdecode(error.filename) if not isinstance(error.filename, int) else "a file"
        shown = path if len(path) <= _LONGEST_SHOWN else f"{path[:_LONGEST_SHOWN]}..."
        return f"{shown}: {str(error.strerror).lower()}; check the path"
    if isinstance(error, UnicodeEncodeError) and "surrogates" in error.reason:
        shown = error.object[:_LONGEST_SHOWN].encode(errors="replace").decode()
        return f"{shown}: is no UTF-8; write it in UTF-8"
    return None


def _refused_by_the_system(error: Exception) -> str | None:
    """Return what the system has no more of, with the remedy; None if that is not the error.

    That is not an error in the program, so that nobody needs its traceback.
    """
    from rig.reserves import SHORT, limits_address_space, refusal, remedy_for

    if isinstance(error, MemoryError):
        return refusal(OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)))
    unnumbered = isinstance(error, ImportError) or (
        isinstance(error, OSError) and error.errno is None
    )
    if unnumbered and limits_address_space():
        # A library that finds no memory says that it cannot be loaded.
        return f"{one_line(error)}; {remedy_for(OSError(errno.ENOMEM, ''))}"
    if isinstance(error, OSError) and error.errno in (*SHORT, *_NO_SPACE):
        return refusal(error)
    return None


class Problems:
    """A collection of the problems of the inputs read so far; the same line is kept once."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    @property
    def found(self) -> bool:
        """Whether there is any problem."""
        return bool(self._lines)

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect the problems of an input that the block reads; the error ends the block quietly.

        An error that lists no problems of the input is raised on.
        """
        try:
            yield
        except ValueError as error:
            if not is_bad_input(error):
                raise
            self._lines |= dict.fromkeys(str(error).splitlines())

    def add(self, line: str) -> None:
        """Add one problem."""
        self._lines[line] = None

    def report(self) -> int:
        """Write all problems to stderr; return `EXIT_BAD_INPUT`, or 0 if there are none."""
        for line in self._lines:
            click.echo(line, err=True)
        return EXIT_BAD_INPUT if self.found else 0


@contextmanager
def ending(
    code: int, *errors: type[Exception], before: str = "", after: str = ""
) -> Iterator[None]:
    """End the command with a message on stderr if the block raises one of some errors.

    Args:
        code: the command's exit code if it is ended.
        errors: the classes of the errors that end it.
        before: the text on stderr before the error's own message.
        after: the text on stderr after that message.

    Raises:
        click.exceptions.Exit: the message is on stderr already.
    """
    try:
        yield
    except errors as error:
        click.echo(f"{before}{error}{after}", err=True)
        raise click.exceptions.Exit(code) from error


def one_line(error: BaseException) -> str:
    """Return the type and message of an exception on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def _keep_traceback() -> str:
    """Write the traceback of the exception being handled to a temporary file; return its path."""
    name = f"rig-error-{datetime.now(UTC):%Y%m%dT%H%M%SZ}-"
    with tempfile.NamedTemporaryFile(
        "w", prefix=name, suffix=".log", delete=False, encoding="utf-8"
    ) as log:
        log.write(traceback.format_exc())
    return log.name


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    click.echo(f"warning: {message}", err=True)
