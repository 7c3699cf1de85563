"""A rig that is streamed, and a client that follows it."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.stream.client import StreamClient
from tests.rig.supervisor.processes.streamed_rig import CHANNELS, Bench
from tests.waiting import PATIENCE_S


@pytest.fixture
def bench(tmp_path: Path, port: int) -> Iterator[Bench]:
    bench = Bench(tmp_path, port)
    bench.stream.attach(bench.board, CHANNELS)
    yield bench
    bench.stream.close()
    os.close(bench.board.fd)


@pytest.fixture
def port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def client(bench: Bench) -> Iterator[StreamClient]:
    with StreamClient(bench.settings) as client:
        client.wait_for_rig(PATIENCE_S)
        yield client
