"""`rig home`: what it prints, and what it leaves behind."""

from collections.abc import Callable
from pathlib import Path

import pytest

import rig.cli.hardware.home
from rig.io.driver import DriverError
from rig.loop.interlocks.trip import TripError
from tests.rig.cli.conftest import Invoke


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Callable[[Exception | None], None]:
    """Put a session that prints its line, or fails, in the place of a real one."""

    class ShownSession:
        error: Exception | None = None

        def __init__(self, connected: tuple[object, ...]) -> None:
            self._directory, self._say = connected[3], connected[5]

        def __enter__(self) -> None:
            if self.error is not None:
                raise self.error
            assert isinstance(self._directory, Path)
            assert self._directory.is_dir()
            assert callable(self._say)
            self._say("homed: at 3 mm")

        def __exit__(self, *_: object) -> None:
            pass

    def fail_by(error: Exception | None) -> None:
        ShownSession.error = error

    monkeypatch.setattr(rig.cli.hardware.home, "ConnectedRig", lambda *arguments: arguments)
    monkeypatch.setattr(rig.cli.hardware.home, "Session", ShownSession)
    return fail_by


@pytest.mark.usefixtures("session")
def test_it_prints_what_homing_found_and_leaves_nothing_behind(
    invoke: Invoke, tmp_path: Path
) -> None:
    done = invoke("home", "--rig", "emulated")
    assert done == (0, "homed: at 3 mm\n", "")
    assert not list((tmp_path / "runs").iterdir())


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (DriverError("daq", "nobody answers", "switch it on"), 2),
        (TripError("homing failed: no stop; switch it on"), 3),
    ],
)
def test_a_rig_that_cannot_be_homed_is_reported_with_the_remedy(
    invoke: Invoke, session: Callable[[Exception | None], None], error: Exception, code: int
) -> None:
    session(error)
    done = invoke("home", "--rig", "emulated")
    assert done.code == code
    assert "switch it on" in done.err


def test_a_rig_without_an_encoder_to_home_is_refused(invoke: Invoke) -> None:
    done = invoke("home", "--rig", "simulated")
    assert done.code == 2
    assert "simulated has no encoder to home" in done.err
