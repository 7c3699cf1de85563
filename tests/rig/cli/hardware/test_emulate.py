import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

Invoke = Callable[..., Any]
Refused = Callable[..., str]

_ARGUMENTS = ("simulated", "--json", "--set-port", "daq=0", "--set-port", "bypass=0")


def emulate(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.cli", "emulate", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def emulated(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = emulate(*_ARGUMENTS, *arguments)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def refused(invoke: Invoke) -> Refused:
    """Ask for something that is refused, and return the message."""

    def ask(*arguments: str) -> str:
        done = invoke("emulate", *arguments)
        # It may have been the first to compile for this machine, and has said so then.
        said = [line for line in done.out.splitlines() if not line.startswith("compiling ")]
        assert (done.code, said) == (2, [])
        return str(done.err)

    return ask


def test_it_says_what_it_serves_records_it_at_once_and_ends_cleanly_when_asked(
    tmp_path: Path,
) -> None:
    record = tmp_path / "record.jsonl"
    with emulated("--record", str(record), "--control", "0") as process:
        assert process.stdout is not None
        ready = json.loads(process.stdout.readline())
        assert ready["ready"]
        assert ready["pid"] == process.pid
        assert ready["ports"].keys() == {"daq", "bypass", "control"}
        socket.create_connection(("127.0.0.1", ready["ports"]["daq"]), timeout=20.0).close()
        # The system has it already: a kill would not take it away.
        assert json.loads(record.read_text().splitlines()[0])["event"] == "ready"
        os.kill(process.pid, signal.SIGTERM)
        out, errors = process.communicate(timeout=60.0)
    assert (process.returncode, errors) == (0, "")
    ended = json.loads(out)
    assert (ended["ended"], ended["connected"]) == (True, 1)
    events = [json.loads(line)["event"] for line in record.read_text().splitlines()]
    assert events[0] == "ready"
    assert "connected" in events


def test_a_port_in_use_is_refused_with_its_number_and_the_remedy(refused: Refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        reported = refused("simulated", "--set-port", f"daq={port}", "--set-port", "bypass=0")
    assert f"daq: port {port} of 127.0.0.1 is in use" in reported
    assert "another port" in reported


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("simulated", "--set-port", "dag=0"), "did you mean daq?"),
        (("simulated", "--set-port", "daq"), "write daq=15502"),
        (("no_such_rig",), "no_such_rig"),
        ((*_ARGUMENTS, "--record", "/no/such/folder/record.jsonl"), "/no/such/folder"),
    ],
)
def test_bad_input_is_refused_with_the_remedy(
    refused: Refused, arguments: tuple[str, ...], reported: str
) -> None:
    assert reported in refused(*arguments)


def test_a_script_with_mistakes_is_refused_before_anything_is_served(
    refused: Refused, tmp_path: Path
) -> None:
    script = tmp_path / "script.yaml"
    script.write_text("faults:\n  - {fault: dely}\n  - {fault: sensor}\n")
    reported = refused(*_ARGUMENTS, "--script", str(script))
    assert "script.yaml:2" in reported
    assert "script.yaml:3" in reported


def test_a_script_for_a_device_that_the_rig_has_not_is_refused(
    refused: Refused, tmp_path: Path
) -> None:
    script = tmp_path / "script.yaml"
    script.write_text("faults:\n  - {fault: meter_noise}\n  - {fault: drive_fault}\n")
    reported = refused(*_ARGUMENTS, "--script", str(script))
    assert "no flow meters" in reported
    assert "no servovalve on CAN" in reported
