"""Packed columns take few bytes, and give every value back."""

import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.recording.formats.packed_columns import packed, unpacked

N = 500
TICKS = np.arange(N)

AWKWARD = st.one_of(
    st.floats(width=64),
    st.sampled_from([-0.0, 0.0, np.nan, np.inf, -np.inf, 2.0**53, -(2.0**53), 5e-324, 1.7e308]),
    st.integers(-(2**53), 2**53).map(float),
    st.integers(-(10**12), 10**12).map(lambda k: k * 1e-9),
    st.integers(-(10**9), 10**9).map(lambda k: k * 1e-3),
)


def bits_of(rows: NDArray[np.float64]) -> list[int]:
    """The bits of values in which every NaN is the same."""
    canonical = np.where(np.isnan(rows), np.nan, rows)
    bits: list[int] = np.ascontiguousarray(canonical).view("<u8").ravel().tolist()
    return bits


@given(
    rows=st.integers(1, 4).flatmap(
        lambda width: st.lists(
            st.lists(AWKWARD, min_size=width, max_size=width), min_size=1, max_size=20
        )
    )
)
def test_every_value_comes_back_bit_for_bit(rows: list[list[float]]) -> None:
    array = np.array(rows)
    again = unpacked(packed(array), *array.shape)
    assert bits_of(again) == bits_of(array)


@pytest.mark.parametrize(
    ("column", "most"),
    [
        (np.full(N, np.nan), 9),
        (TICKS * 1e-3, 2 * N + 2),
        (np.where(TICKS % 40 == 7, np.nan, TICKS + 2e4), 3 * N),
        (np.random.default_rng(1).integers(10_000, 40_000, N) * 1e-9, 3 * N),
        (np.random.default_rng(1).standard_normal(N), 8 * N + 1),
        (np.random.default_rng(1).standard_normal(N) * (TICKS > 9), 8 * N + 1),
    ],
    ids=["nothing", "time", "counter with gaps", "stage times", "noise", "noise from later on"],
)
def test_a_column_takes_no_more_than_its_numbers_need(
    column: NDArray[np.float64], most: int
) -> None:
    data = packed(column[:, None])
    assert len(data) <= most
    assert bits_of(unpacked(data, N, 1)) == bits_of(column)


def test_bytes_that_are_no_packed_columns_are_refused() -> None:
    whole = packed(np.column_stack([TICKS * 1.0, np.sin(TICKS)]))
    for data, fault in (
        (whole[:-1], "is cut off"),
        (whole + b"\0", "1 bytes follow"),
        (b"\x40" + whole, "of kind 64"),
        (bytes([2 | 4 | 32]), "of kind 38"),
        (bytes([2, 9]), "numbers of 9 bytes"),
    ):
        with pytest.raises(ValueError, match=fault):
            unpacked(data, N, 2)


@given(at=st.integers(0, 2**31), bit=st.integers(0, 7))
def test_whatever_the_bytes_are_they_end_in_values_or_in_a_reason(at: int, bit: int) -> None:
    data = bytearray(packed(np.column_stack([TICKS * 1e-3, np.sin(TICKS)])[:20]))
    data[at % len(data)] ^= 1 << bit
    with suppress(ValueError, struct.error):
        assert unpacked(bytes(data), 20, 2).shape == (20, 2)
