"""A recording in memory, its units and its fingerprint."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rig.recording import Recording, unit_of


@pytest.mark.parametrize(
    ("channel", "unit"),
    [
        ("time_s", "s"),
        ("command_V", "V"),
        ("position_m", "m"),
        ("pressure_1_Pa", "Pa"),
        ("load_N", "N"),
        ("est_velocity_m_per_s", "m/s"),
        ("flow_1_m3_per_s", "m^3/s"),
        ("true_leak_1_L_per_min", "L/min"),
        ("est_leak_1_m3_per_s_sqrtPa", "m^3/(s sqrt(Pa))"),
        ("innovation_pressure_1_Pa", "Pa"),
    ],
)
def test_a_channels_name_shows_its_unit(channel: str, unit: str) -> None:
    assert unit_of(channel) == unit


@pytest.mark.parametrize("channel", ["cycle", "state_index", "m", "pressure_1_pa"])
def test_a_name_without_a_known_suffix_has_no_unit(channel: str) -> None:
    assert unit_of(channel) == ""


def test_a_missing_channel_is_named_with_those_present(healthy: Recording) -> None:
    with pytest.raises(KeyError, match=r"no channel 'load_N'.*pressure_2_Pa, spool_m"):
        healthy["load_N"]


@pytest.mark.parametrize(
    ("channels", "fault"),
    [
        ({"position_m": np.zeros(3)}, "first channel must be time_s"),
        ({"time_s": np.zeros(3), "position_m": np.zeros(2)}, "position_m.*shape"),
        ({"time_s": np.zeros(3), "position_m": np.zeros(3, np.float32)}, "position_m: float32"),
    ],
)
def test_channels_are_float64_equally_long_and_begin_with_time(
    channels: dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]], fault: str
) -> None:
    with pytest.raises(ValueError, match=fault):
        Recording(channels)


def test_the_fingerprint_is_of_the_data_alone(healthy: Recording) -> None:
    backwards = dict(reversed(healthy.channels.items()))
    reordered = {"time_s": backwards["time_s"]} | backwards
    assert Recording(reordered, {"other": 1}, [], "x").content_hash() == healthy.content_hash()


@pytest.mark.parametrize("channel", ["time_s", "position_m", "spool_m"])
def test_one_changed_bit_changes_the_fingerprint(healthy: Recording, channel: str) -> None:
    values = healthy[channel].copy()
    values[7] = np.nextafter(values[7], np.inf)
    changed = Recording(healthy.channels | {channel: values})
    assert changed.content_hash() != healthy.content_hash()


def test_the_sign_of_zero_counts_in_the_fingerprint_and_the_bits_of_a_nan_do_not() -> None:
    def fingerprint(value: float) -> str:
        return Recording({"time_s": np.zeros(1), "load_N": np.array([value])}).content_hash()

    odd_nan = float(np.array([0x7FF8000000000123], dtype=np.uint64).view(np.float64)[0])
    assert fingerprint(0.0) != fingerprint(-0.0)
    assert fingerprint(odd_nan) == fingerprint(float("nan"))


def test_the_package_loads_no_file_format_before_it_is_needed_and_pandas_for_none(
    tmp_path: Path,
) -> None:
    program = """
import sys
from pathlib import Path
from rig.recording import Recording
print(*sys.modules)
import numpy as np
from rig.recording import write_csv
write_csv(Recording({"time_s": np.array([0.5, np.nan])}), Path(sys.argv[1]), compressed=False)
print(*sys.modules)
"""
    found = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "rows.csv")],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded, later = (set(line.split()) for line in found.stdout.splitlines())
    assert "rig.recording.recording" in loaded
    assert loaded.isdisjoint({"mcap", "pyarrow", "zstandard", "lz4"})
    assert (tmp_path / "rows.csv").read_text() == "time_s\n0.5\n\n"
    assert "pyarrow" in later
    assert "pandas" not in later
