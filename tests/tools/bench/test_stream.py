"""The benchmark of the stream publishes what is asked for; what it measures is no test's."""

import json
import subprocess
import sys
from typing import Any

import pytest

from tools.bench import stream
from tools.bench.stream import fleet

# Says that it is ready, waits for the end of its input, and reports; it stands for any process.
_PLAIN = "import sys; print('ready', flush=True); sys.stdin.read(); print('{\"late_s\": 0.5}')"


@pytest.mark.parametrize("count", [2, 4, 7])
def test_a_fleet_has_all_of_its_rigs(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    published: list[int] = []
    popen = subprocess.Popen

    def plain(command: list[str], **given: Any) -> Any:
        if "--publish" in command:
            published.append(int(command[-2]))
        return popen([sys.executable, "-S", "-c", _PLAIN], **given)

    def follower(endpoint: str, mode: str, seconds: float) -> Any:
        told = f"print({json.dumps({'alive': sum(published)})!r})"
        return popen([sys.executable, "-S", "-c", told], stdout=subprocess.PIPE, text=True)

    monkeypatch.setattr(subprocess, "Popen", plain)
    monkeypatch.setattr(stream, "follower", follower)
    found = fleet(1.0, 1, count, 20)
    assert found["alive"] == count
    assert found["late_s"] == 0.5
    assert 0 not in published
