from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.recording import McapWriter, Recording, export, read_recording

Invoke = Callable[..., Any]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three seconds of a recording with an event."""
    path = tmp_path / "recording.mcap"
    with McapWriter(path, ["time_s", "position_m"], {"seed": 1}) as writer:
        writer.event(0.0, "test_begin", "x")
        time_s = np.arange(3000) * 1e-3
        writer.write(np.column_stack([time_s, np.sin(time_s)]))
    return path


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz", "out.parquet", "out.mcap"])
def test_an_export_reads_back_bit_for_bit(
    invoke: Invoke, recording: Path, tmp_path: Path, name: str
) -> None:
    done = invoke("export", recording, tmp_path / name)
    assert done[:2] == (0, f"{tmp_path / name}: 3000 samples of 2 channels\n")
    assert bool(done.err) == (name == "out.csv")  # which has no checksum
    before = read_recording(recording, required=())
    after = read_recording(tmp_path / name, required=())
    assert before.content_hash() == after.content_hash()
    assert before.metadata == after.metadata
    assert before.events == after.events


@pytest.mark.parametrize("out", ["out.txt", "nowhere/out.csv", "/proc/out.csv"])
def test_what_cannot_be_exported_to_is_bad_input(invoke: Invoke, recording: Path, out: str) -> None:
    done = invoke("export", recording, out)
    assert done.code == 2
    assert done.err.startswith(f"{out}: file: ")
    assert "Traceback" not in done.err


def test_a_cut_recording_is_recovered_up_to_the_cut(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) // 2])
    done = invoke("replay", recording)
    assert done.code == 2
    assert f"rig recover {recording}" in done.err
    done = invoke("recover", recording, tmp_path / "saved.mcap")
    assert done.code == 0
    assert "cut off" in done.out
    assert len(read_recording(tmp_path / "saved.mcap", required=())) in (1000, 2000)


@pytest.mark.parametrize(
    ("source", "out"),
    [("nowhere.mcap", "saved.mcap"), ("recording.mcap", "recording.mcap"), ("x.csv", "saved.mcap")],
)
def test_what_cannot_be_recovered_is_bad_input(
    invoke: Invoke, recording: Path, tmp_path: Path, source: str, out: str
) -> None:
    time_s = np.arange(2000, dtype=np.float64) * 1e-3
    export(Recording({"time_s": time_s}), tmp_path / "x.csv")
    done = invoke("recover", source, out)
    assert done.code == 2
    assert "Traceback" not in done.err
    assert not (tmp_path / "saved.mcap").exists()


def test_init_gives_copies_that_names_then_mean(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = invoke("init", "mine")
    assert done.code == 0
    assert "mine/campaigns/quickstart.yaml" in done.out.splitlines()
    copy = tmp_path / "mine" / "campaigns" / "quickstart.yaml"
    copy.write_text(copy.read_text().replace("name: quickstart", "name: edited"))
    monkeypatch.chdir(tmp_path / "mine")
    assert "campaign edited" in invoke("check", "quickstart").out


def test_init_replaces_nothing(invoke: Invoke, tmp_path: Path) -> None:
    (tmp_path / "precious.txt").touch()
    done = invoke("init", ".")
    assert done.code == 2
    assert "is not empty" in done.err
    assert [file.name for file in tmp_path.iterdir()] == ["precious.txt"]
