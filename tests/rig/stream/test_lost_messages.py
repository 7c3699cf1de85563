"""A reader asks again for what was lost on the way, so that it misses nothing for good."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from rig.stream.client import StreamClient
from rig.stream.messages import Samples
from rig.stream.sender import StreamSender
from rig.stream.sessions import publisher_session
from rig.stream.settings import Endpoint, StreamSettings
from tests.waiting import until


class Lossy(StreamSender):
    """A sender of which some messages get lost, as on a busy machine.

    Attributes:
        lost: kinds whose messages get lost.
    """

    lost: frozenset[str] = frozenset()

    def _publisher(self, kind: str) -> Any:
        return _Nowhere() if kind in self.lost else super()._publisher(kind)

    def samples(self, first_row: int) -> None:
        rows = np.arange(first_row, first_row + 10)
        values = rows[:, np.newaxis].astype(np.float32)
        self.send(
            "samples",
            Samples(1, first_row, 1, 0, np.asarray(rows * 1e-3, np.float64), values).content(),
        )

    def heartbeat(self) -> None:
        content = {"heartbeat_s": 0.5, "sequences": dict(self.sequences), "rows": 0, "up_s": 1.0}
        self.send("heartbeat", content)


class _Nowhere:
    def put(self, payload: bytes) -> None:
        del payload


def test_messages_that_are_lost_are_asked_for_again(
    port: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    settings = StreamSettings(listen=(Endpoint("tcp", "127.0.0.1", port),))
    session: zenoh.Session = publisher_session(settings)
    with session, StreamClient(settings) as client:
        rig = Lossy(session, "bench", 30.0, print)
        until(client.rigs, "the rig", meanwhile=rig.heartbeat)
        # The questions of one that joins late have been answered.
        until(lambda: not any(each.is_alive() for each in client._asking), "its first answers")
        rig.lost = frozenset({"channels"})
        rig.send("channels", {"id": 1, "names": ["position_m"], "units": ["m"]})
        rig.samples(0)
        until(lambda: len(client.window(10.0).row) == 10, "samples whose names were lost")
        rig.lost = frozenset({"samples", "state", "event"})
        rig.send("state", {"state": "holding"})
        rig.send("event", {"text": "oil on the floor"})
        rig.samples(10)
        rig.lost = frozenset()
        rig.heartbeat()
        rig.samples(20)
        until(lambda: len(client.window(10.0).row) == 30, "the samples that were lost")
        assert client.window(10.0).values["position_m"].tolist() == list(range(30))
        assert "rows" not in client.snapshot().missing
        rig.close()
