"""What is sent arrives as it was, and bytes that are no message are refused."""

import msgpack
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from rig.stream.batches import Batches
from rig.stream.messages import (
    Channels,
    MessageError,
    Samples,
    finite,
    key,
    pack,
    rig_and_kind,
    rig_id,
    unpack,
)

HEADER = {"version": 1, "session": "s", "sequence": 0, "sent_ns": 1}


@given(
    hnp.arrays(np.float32, st.tuples(st.integers(1, 9), st.integers(1, 5))),
    st.integers(0, 2**60),
)
def test_samples_arrive_bit_for_bit(values: np.ndarray, first_row: int) -> None:
    samples = Samples(3, first_row, 2, 10**18, np.arange(len(values), dtype=np.float64), values)
    back = Samples.of(unpack(pack({**HEADER, **samples.content()})))
    assert back.values.tobytes() == values.tobytes()
    assert (back.channels_id, back.first_row, back.test) == (3, first_row, 2)
    np.testing.assert_array_equal(back.time_s, samples.time_s)


@given(st.binary(max_size=100))
def test_bytes_that_are_no_message_are_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        unpack(payload)


def test_a_message_with_a_key_twice_is_refused_by_the_key_s_name() -> None:
    payload = pack({**HEADER, "verdict": "healthy"})
    twice = bytes([payload[0] + 1]) + payload[1:] + msgpack.packb("verdict") + msgpack.packb("x")
    with pytest.raises(MessageError, match="the key 'verdict' twice"):
        unpack(twice)


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"session": 1}, {"sequence": "0"}, {"sent_ns": None}], ids=str
)
def test_a_message_with_another_header_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(MessageError):
        unpack(msgpack.packb({**HEADER, **change}))


@pytest.mark.parametrize(
    "change",
    [{"rows": 2}, {"rows": -1}, {"values": b"123"}, {"time_s": "x"}, {"channels_id": None}],
    ids=str,
)
def test_samples_that_do_not_fit_are_refused(change: dict[str, object]) -> None:
    samples = Samples(1, 0, 0, 0, np.zeros(3), np.zeros((3, 2), np.float32))
    with pytest.raises(MessageError):
        Samples.of({**samples.content(), **change})


def test_channels_without_units_are_refused() -> None:
    assert Channels.of(Channels(1, ("a",), ("m",)).content()) == Channels(1, ("a",), ("m",))
    with pytest.raises(MessageError):
        Channels.of({"id": 1, "names": ["a"], "units": []})


@given(st.text())
def test_any_name_makes_a_rigs_key(name: str) -> None:
    text = key(rig_id(name), "samples")
    assert rig_and_kind(text) == (rig_id(name), "samples")
    assert not set("*$#?/ ") & set(rig_id(name))


@pytest.mark.parametrize("text", ["rig/a/v2/samples", "other/a/v1/samples", "rig/a"])
def test_a_key_of_something_else_is_refused(text: str) -> None:
    with pytest.raises(MessageError):
        rig_and_kind(text)


def test_numbers_that_are_none_are_sent_as_none() -> None:
    told = {"a": float("nan"), "b": [1, float("inf"), "x"], "c": np.float64(2.0), "d": None}
    assert finite(told) == {"a": None, "b": [1, None, "x"], "c": 2.0, "d": None}


def batches(size: int = 10) -> Batches:
    gathered = Batches(size)
    assert gathered.set_columns(("time_s", "position_m"), ("s", "m"), 1)
    return gathered


def rows(first: int, count: int) -> np.ndarray:
    numbers = np.arange(first, first + count)
    return np.column_stack([numbers * 1e-3, numbers.astype(float)])


@given(st.lists(st.tuples(st.integers(1, 25), st.integers(0, 3)), max_size=20))
def test_batches_hold_every_row_once_and_none_spans_a_hole(
    pieces: list[tuple[int, int]],
) -> None:
    gathered, at = batches(), 0
    sent: list[Samples] = []
    given_rows: list[int] = []
    for count, hole in pieces:
        at += hole
        given_rows += range(at, at + count)
        sent += gathered.add(at, rows(at, count), 5)
        at += count
    sent += gathered.flush()
    held = [s.first_row + k for s in sent for k in range(len(s.time_s))]
    assert held == given_rows
    for samples in sent:
        assert len(samples.time_s) <= 10
        np.testing.assert_array_equal(
            samples.values[:, 0], samples.first_row + np.arange(len(samples.time_s))
        )


def test_only_channels_that_are_wanted_are_sent() -> None:
    gathered = Batches(2, ("b", "nowhere"))
    gathered.set_columns(("time_s", "a", "b"), ("s", "m", "V"), 1)
    assert gathered.channels == Channels(1, ("b",), ("V",))
    (samples,) = gathered.add(0, np.array([[0.0, 1.0, 2.0], [1.0, 3.0, 4.0]]), 0)
    assert samples.values.tolist() == [[2.0], [4.0]]


def test_channels_get_a_new_number_only_when_they_change() -> None:
    gathered = batches()
    assert not gathered.set_columns(("time_s", "position_m"), ("s", "m"), 2)
    assert gathered.set_columns(("time_s", "command_V"), ("s", "V"), 3)
    assert gathered.channels.number == 2


def test_a_value_beyond_single_precision_is_sent_as_infinite() -> None:
    (samples,) = batches(1).add(0, np.array([[0.0, 1e300]]), 0)
    assert np.isinf(samples.values[0, 0])
