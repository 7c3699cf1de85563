"""A file in which a key is given twice is refused by file and line, whatever kind of file it is."""

import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from estimator.baselines.baseline import BaselineError
from estimator.baselines.baseline_file import load_baseline
from rig.accounts.account_file import AccountFile, AccountsError
from rig.console.queue.queue_file import QueueError, QueueFile
from rig.plant import Model
from rig.recording.errors import RecordingError
from rig.recording.reading import read_recording
from rig.recording.recording import events_from
from rig.runner.counters.store import CounterError, read_counters
from rig.runner.run_folder.archive import RunError, read_run
from rig.runner.run_folder.journal import _entry
from rig.sweep.folder import read_identity
from rig.unique_keys import RepeatedLineError, json_of

TWICE = '{\n "version": 1,\n "at": {"version": 2, "\\u0061t": "}"},\n "version": 1\n}\n'
"""A text whose fourth line repeats a key of the second, as no other key does in its object."""


def beside_a_recording(path: Path) -> object:
    times = "\n".join(f"{1e-3 * n},0,0.3,1e6,1e6" for n in range(1001))
    head = "time_s,command_V,position_m,pressure_1_Pa,pressure_2_Pa"
    path.with_suffix("").write_text(f"{head}\n{times}\n")
    return read_recording(path.with_suffix(""))


READERS: dict[str, tuple[str, Callable[[Path], object], type[Exception]]] = {
    "results": ("results.json", lambda path: read_run(path.parent), RunError),
    "baseline": ("rig.json", lambda path: load_baseline(path, Model()), BaselineError),
    "counters": ("rig.json", lambda path: read_counters("rig", path), CounterError),
    "accounts": ("accounts.json", lambda path: AccountFile(path).read(), AccountsError),
    "queue": ("console-queue.json", lambda path: QueueFile(path.parent).read(), QueueError),
    "beside a CSV": ("run.csv.json", beside_a_recording, RecordingError),
}


@pytest.mark.parametrize("kind", READERS)
def test_a_key_that_is_given_twice_is_refused_by_file_and_line(tmp_path: Path, kind: str) -> None:
    name, read, error = READERS[kind]
    path = tmp_path / name
    path.write_text(TWICE)
    path.chmod(0o600)
    with pytest.raises(error) as raised:
        read(path)
    told = str(raised.value)
    assert told.startswith(f"{path}:4: ")
    assert "'version' is given twice, first in line 2" in told


def test_a_whole_number_beyond_every_float_is_refused() -> None:
    with pytest.raises(ValueError, match="a whole number of 400 digits"):
        json_of(f'{{"value": {"9" * 400}}}')


@pytest.mark.parametrize("changed", ['"at_ms": 1' + 40 * "0", '"next_number": 1e999'])
def test_a_queue_with_a_time_or_a_number_that_none_can_be_is_refused(
    tmp_path: Path, changed: str
) -> None:
    text = (
        '{"version": 1, "entries": [{"number": 1, "campaign": "a", "by": "Bo", "at_ms": 1, '
        '"is_begun": false}], "offered": ["a"], "next_number": 2}'
    )
    key = changed.partition(":")[0]
    path = tmp_path / "console-queue.json"
    path.write_text(re.sub(rf"{key}: \d+", changed, text))
    path.chmod(0o600)
    with pytest.raises(QueueError, match="no queue of version 1"):
        QueueFile(tmp_path).read()


def test_what_is_only_read_by_programs_is_as_damaged_if_a_key_is_given_twice(
    tmp_path: Path,
) -> None:
    (tmp_path / "sweep.json").write_text(TWICE)
    assert read_identity(tmp_path) is None
    for number, is_read in ((b'"n": 0', True), (b'"n": 1, "n": 0', False)):
        text = b'{%s, "at": "", "kind": "begin"' % number
        line = b'%s, "crc": "%08x"}\n' % (text, zlib.crc32(text + b"}"))
        assert (_entry(line) is not None) is is_read
    with pytest.raises(RepeatedLineError):
        events_from(b'[[0, {"a": 1, "a": 1}, ""]]')


@settings(max_examples=20)
@given(st.recursive(
    st.text() | st.integers() | st.none(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
))  # fmt: skip
def test_what_has_each_key_once_is_read_as_it_was_written(value: object) -> None:
    assert json_of(json.dumps(value, indent=1)) == value
    with pytest.raises(RepeatedLineError) as raised:
        json_of(f'{{"k": 0,\n"of": {json.dumps(value)},\n"\\u006b": 1}}')
    assert raised.value.line == 3
