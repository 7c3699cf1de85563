"""Readers of the live stream that are stalled cost the others next to nothing."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from rig.stream import sessions
from rig.stream.client import StreamClient
from tests.rig.supervisor.processes.streamed_rig import Bench
from tests.waiting import PATIENCE_S, until


def status(process: "subprocess.Popen[bytes]") -> str:
    return Path(f"/proc/{process.pid}/status").read_text()


def test_stalled_readers_cost_the_others_nothing(
    bench: Bench, client: StreamClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = (
        "import os, signal, sys\n"
        "from rig.stream.settings import Endpoint, StreamSettings\n"
        "from rig.stream.sessions import publisher_session, subscriber_session\n"
        "s = subscriber_session(StreamSettings(), (Endpoint.parse(sys.argv[1]),))\n"
        "s.declare_subscriber('rig/*/v1/*', lambda sample: None)\n"
        "print('here', flush=True)\nsys.stdin.readline()\n"
        "for _ in range(20): s.get('rig/bench/v1/event', lambda reply: None)\n"
        "os.kill(os.getpid(), signal.SIGSTOP)\n"
    )
    stalled = [
        subprocess.Popen(
            [sys.executable, "-c", program, str(bench.settings.listen[0])],
            stdout=subprocess.PIPE,
            stdin=subprocess.PIPE,
        )
        for _ in range(3)
    ]
    try:
        for process in stalled:
            assert process.stdout is not None
            process.stdout.readline()
            process.send_signal(signal.SIGSTOP)
        # More than all buffers between here and there hold.
        wide = threading.Event()
        for _ in range(20):
            for _ in range(10):
                bench.stream.event("test", "note", "x" * 20_000)
            bench.write(50)
            wide.wait(0.02)
        # A machine that stalls may drop samples for this reader, too; it asks for them again.
        until(lambda: len(client.history(60.0).row) == 1000)
        assert "rows" not in client.snapshot().missing
        # One that asks and takes no answers delays the others by a second, of Zenoh's usual five.
        asker = stalled[0]
        asker.send_signal(signal.SIGCONT)
        assert asker.stdin is not None
        asker.stdin.write(b"\n")
        asker.stdin.flush()
        until(lambda: asker.poll() is None and "T (stopped)" in status(asker), "it to stall")
        assert client._session is not None
        answers = client._session.get("rig/bench/v1/heartbeat", timeout=3.5)
        assert any(answer.ok for answer in answers)
        # Who comes and goes meanwhile is not kept waiting for the others, nor told of an error.
        monkeypatch.setattr(sessions, "REACH_MS", 200)
        with StreamClient(bench.settings) as passing:
            passing.wait_for_rig(PATIENCE_S)
    finally:
        for process in stalled:
            process.kill()
            process.communicate()
