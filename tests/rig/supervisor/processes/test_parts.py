"""The parts of a session start together or not at all."""

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from rig.supervisor.processes import safety_thread
from rig.supervisor.processes.safety_thread import Parts


def test_if_a_part_cannot_be_started_the_others_are_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []

    class Starting:
        """A part for the third of which there are no descriptors."""

        def __init__(self, name: str, module: str, *_: object) -> None:
            if len(started) == 2:
                raise OSError(errno.EMFILE, "Too many open files")
            self.name = name
            started.append(name)

        def end(self) -> None:
            started.remove(self.name)

    monkeypatch.setattr(safety_thread, "Child", Starting)
    heard = cast(Callable[[Any], None], started.append)
    with pytest.raises(OSError, match="Too many open files"):
        Parts.start(cast(Any, None), tmp_path / "log", heard)
    assert started == []
