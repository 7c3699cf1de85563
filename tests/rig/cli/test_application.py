import errno
import gc
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

import rig.cli.application
from rig import __version__
from rig.cli.application import COMMANDS
from rig.runner.experiments.gap_closing import ROUNDS

Invoke = Callable[..., Any]


def helped(*command: str) -> tuple[str, set[str]]:
    """Return what a command's help says in a process of its own, and the modules that it loads."""
    program = (
        f"import sys; sys.argv[1:] = {[*command, '--help']}\n"
        "from rig.cli import main\n"
        "try: main()\n"
        "finally: print('LOADED', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    said, _, loaded = done.stdout.partition("LOADED")
    return said, set(loaded.split())


HEAVY = {"numpy", "numba", "pyarrow", "pint", "plotly", "pydantic", "rich", "yaml"}


def test_garbage_is_collected_again_once_a_command_is_loaded_or_could_not_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    states: list[bool] = []

    def load(name: str) -> None:
        states.append(gc.isenabled())
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("rig.cli.application.import_module", load)
    monkeypatch.setitem(COMMANDS, "lost", ("nowhere.lost", ""))
    group = rig.cli.application.application
    with pytest.raises(ModuleNotFoundError):
        group.get_command(click.Context(group), "lost")
    assert [*states, gc.isenabled()] == [False, True]


def test_help_lists_every_command_and_loads_none_of_what_they_need() -> None:
    listed, loaded = helped()
    assert all(f"  {name} " in listed for name in COMMANDS)
    assert HEAVY.isdisjoint(loaded)


def test_the_help_of_the_gap_workflow_compiles_nothing() -> None:
    said, loaded = helped("gap")
    assert f"at most; {ROUNDS} if not given" in said
    assert HEAVY.isdisjoint(loaded)


def test_the_version_is_the_package_s(invoke: Invoke) -> None:
    assert invoke("--version") == (0, f"rig, version {__version__}\n", "")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(invoke: Invoke, command: str) -> None:
    done = invoke(command, "--help")
    assert done.code == 0
    assert f"Usage: rig {command}" in done.out
    assert "\\" not in done.out


@pytest.mark.parametrize("arguments", [["rnu"], ["run"], ["run", "x", "--pace", "slow"], ["--bad"]])
def test_wrong_usage_is_bad_input(invoke: Invoke, arguments: list[str]) -> None:
    done = invoke(*arguments)
    assert done.code == 2
    assert done.out == ""
    assert "Error" in done.err


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], None]:
    """Make `rig init` raise."""

    def fail_with(error: BaseException) -> None:
        @click.command()
        def command() -> int:
            raise error

        monkeypatch.setattr(
            rig.cli.application.LazyGroup, "get_command", lambda group, ctx, name: command
        )

    return fail_with


def test_an_unknown_error_is_one_line_that_shows_where_the_traceback_is(
    invoke: Invoke,
    failing: Callable[[BaseException], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    failing(RuntimeError("out of\noil"))
    done = invoke("init")
    (log,) = tmp_path.glob("rig-error-*.log")
    assert done == (1, "", f"rig: RuntimeError: out of oil; traceback in {log}\n")
    assert "Traceback" in log.read_text()


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (OSError(errno.EMFILE, "Too many open files", "/a"), "/a: too many open files; allow"),
        (OSError(errno.ENOSPC, "No space left on device"), "no space left on device; free space"),
        (MemoryError(), "cannot allocate memory; end other programs"),
    ],
)
def test_what_the_system_has_no_more_of_is_told_with_its_remedy_and_without_a_traceback(
    invoke: Invoke, failing: Callable[[BaseException], None], error: Exception, told: str
) -> None:
    failing(error)
    done = invoke("init")
    assert done.code == 3
    assert done.err.startswith(f"rig: {told}")
    assert "traceback" not in done.err


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.EACCES, "permission denied"),
        (errno.EROFS, "read-only file system"),
        (errno.ENOTDIR, "not a directory"),
        (errno.EISDIR, "is a directory"),
    ],
)
def test_a_path_that_may_not_be_used_is_bad_input_and_no_crash(
    invoke: Invoke, failing: Callable[[BaseException], None], number: int, told: str
) -> None:
    failing(OSError(number, os.strerror(number), "/locked/run"))
    assert invoke("init") == (2, "", f"/locked/run: {told}; check the path\n")


def test_an_interrupt_before_anything_ran_is_a_stop(
    invoke: Invoke, failing: Callable[[BaseException], None]
) -> None:
    failing(KeyboardInterrupt())
    done = invoke("init")
    assert done.code == 3
    assert "Traceback" not in done.err


def test_output_that_nobody_reads_is_no_crash() -> None:
    program = "from rig.cli import main; main(['check', *['nominal'] * 20000])"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 1


def test_output_that_cannot_be_written_is_told_once_and_raises_nothing() -> None:
    program = (
        "import sys\n"
        "from rig.cli.screen import Screen\n"
        "screen = Screen(on_closed=lambda: print('closed', file=sys.stderr))\n"
        "screen.print('one')\n"
        "screen.print('two')\n"
    )
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", program], stdout=full, stderr=subprocess.PIPE, check=False
        )
    assert (done.returncode, done.stderr) == (0, b"closed\n")


def test_without_any_output_a_command_does_what_it_should() -> None:
    done = subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -m rig.cli check quickstart >&- 2>&-'],
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0
