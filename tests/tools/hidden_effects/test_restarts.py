"""Short horizons tell a rig that made a recording from one that did not."""

from pathlib import Path

import numpy as np
import pytest

from tools.hidden_effects.motions import drawn
from tools.hidden_effects.recordings import record, write
from tools.hidden_effects.restarts import SENSOR_NOISE, following, line, main, read
from tools.hidden_effects.rig_values import TABLE

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    biased = TABLE._replace(null_shift=1e-5)
    motion = drawn("multisine", np.random.default_rng(4), 3000)
    file = tmp_path_factory.mktemp("case") / "identify.csv.gz"
    write(record(biased, motion, np.random.default_rng(5)).table, file)
    return file


def test_a_rig_follows_its_own_recording_to_within_the_noise(recording: Path) -> None:
    found = following(TABLE._replace(null_shift=1e-5), read(recording), 2)
    assert found.windows == 15
    assert all(0.5 < found.median[channel] < 1.3 for channel in SENSOR_NOISE), found.median
    assert found.followed > 0.5


def test_another_rig_does_not(recording: Path) -> None:
    found = following(TABLE, read(recording), 2)
    assert found.median["position_m"] > 3.0
    assert found.median["spool_m"] == pytest.approx(1.0, abs=0.2)
    assert found.followed < 0.3


def test_the_program_says_so_in_a_line(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    effects = '{"spool_null_bias": {"value": 1e-5}}'
    main([str(recording.parent), "--effects", effects, "--stride", "7"])
    printed = capsys.readouterr().out.splitlines()[1]
    assert printed == line(
        f"{recording.parent.name}/identify", TABLE._replace(null_shift=1e-5), recording, 7
    )
