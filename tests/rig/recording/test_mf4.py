"""MF4: what is exported is what other tools read."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from rig.recording import Recording, RecordingError, export
from rig.recording.recording import Event


@pytest.fixture
def recording() -> Recording:
    time = np.arange(3000) * 1e-3
    pressure = np.where(time > 2.0, np.nan, 1e7 * np.sin(time))
    channels = {"time_s": time, "position_m": 0.3 + 1e-9 * time, "pressure_1_Pa": pressure}
    return Recording(channels, {"seed": 7}, [Event(0.5, "note", "oil <drips>")])


def test_every_channel_reads_back_bit_for_bit_with_its_unit_over_time(
    recording: Recording, tmp_path: Path
) -> None:
    # Imported here: with its pandas it takes longer than this test.
    from asammdf import MDF

    export(recording, tmp_path / "test.mf4")
    assert [file.name for file in tmp_path.iterdir()] == ["test.mf4"]
    with MDF(tmp_path / "test.mf4") as file:
        for channel, unit in (("position_m", "m"), ("pressure_1_Pa", "Pa")):
            signal = file.get(channel)
            assert signal.unit == unit
            np.testing.assert_array_equal(signal.samples, recording[channel])
            np.testing.assert_array_equal(signal.timestamps, recording.time_s)
        comment = file.header.comment
    reported = comment.partition("<TX>")[2].partition("</TX>")[0] or comment
    plain = reported.replace("&quot;", '"').replace("&lt;", "<").replace("&gt;", ">")
    content = json.loads(plain)
    assert content["metadata"] == {"seed": 7}
    assert content["events"] == [[0.5, "note", "oil <drips>"]]


@pytest.mark.parametrize(
    ("metadata", "year"),
    [({"start_ns": 1_600_000_000_000_000_000}, 2020), ({}, 1970), ({"start_ns": "soon"}, 1970)],
)
def test_the_start_time_is_that_of_the_recording_and_not_of_the_export(
    recording: Recording, tmp_path: Path, metadata: dict[str, object], year: int
) -> None:
    from asammdf import MDF

    few = {name: values[:5] for name, values in recording.channels.items()}
    export(Recording(few, metadata), tmp_path / "test.mf4")
    with MDF(tmp_path / "test.mf4") as file:
        assert file.header.start_time.year == year


def test_without_asammdf_the_remedy_is_reported_and_nothing_written(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(RecordingError, match=r"pip install 'hydraulic-rig\[mf4\]'"):
        export(recording, tmp_path / "test.mf4")
    assert not list(tmp_path.iterdir())
