"""Columns that hardly change, or hold whole numbers, are packed here into few bytes, and unpacked.

A block of rows is packed column after column. The bytes of equal weight stand side by side, as
zstd, which compresses the block afterwards, finds the runs of zeros and of equal bytes then. Every
float64 is given back bit for bit, and a NaN as NaN.
"""

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SAME: Final = 0
"""Kind of a column whose values are all the same: the value, 8 bytes, follows."""
DOUBLES: Final = 1
"""Kind of a column that is kept as it is: 8 planes of n bytes follow, the lowest bytes first."""
WHOLE: Final = 2
"""Kind of a column of whole multiples of a unit. It is a bit of the kind, beside the three below.
There follow the mask of the values that are missing, ceil(n / 8) bytes, if there are any; the
number w of planes; and w planes of n bytes of the multiples, as unsigned numbers."""
_MILLISECONDS: Final = 32
"""Bit of the kind: the unit is 1e-3 instead of 1."""
_NANOSECONDS: Final = 4
"""Bit of the kind: the unit is 1e-9 instead of 1."""
_CHANGES: Final = 8
"""Bit of the kind: not the multiples are kept but how much each is above the one before."""
_MISSING: Final = 16
"""Bit of the kind: some values are missing; their multiples are 0."""
_KINDS: Final = WHOLE | _MILLISECONDS | _NANOSECONDS | _CHANGES | _MISSING

_UNITS: Final = {0: 1.0, _MILLISECONDS: 1e-3, _NANOSECONDS: 1e-9}
"""The loop's counters are whole numbers. It reckons the time of a tick as a whole number times
1e-3, and the times of its stages as whole numbers of ns times 1e-9."""
_LARGEST: Final = 2.0**53
"""Up to here a float64 holds every whole number."""
_LOOKED_AT: Final = 4
"""Number of values at the begin of a column that are tried before all of them are."""
_VALUE: Final = struct.Struct("<d")


def packed(rows: FloatArray) -> bytes:
    """Return rows of shape (n, n_columns), n at least 1, as bytes that compress well."""
    columns = np.ascontiguousarray(rows.T, dtype="<f8")
    bits = columns.view("<u8")
    same = (bits == bits[:, :1]).all(axis=1)
    return b"".join(
        bytes([SAME]) + column[:1].tobytes() if constant else _varying(column)
        for column, constant in zip(columns, same.tolist(), strict=True)
    )


def unpacked(data: bytes, n: int, n_columns: int) -> FloatArray:
    """Return the rows, shape (n, n_columns), that `packed` made these bytes of.

    Raises:
        ValueError: the bytes are not what `packed` makes of so many rows and columns.
    """
    reader = _Bytes(data)
    columns = np.empty((n_columns, n))
    for column in columns:
        kind = reader.take(1)[0]
        if kind == SAME:
            column[:] = _VALUE.unpack(reader.take(8))[0]
        elif kind == DOUBLES:
            column[:] = _joined(reader.take(8 * n), 8, n).view("<f8")
        elif kind & WHOLE and not kind & ~_KINDS:
            column[:] = _multiples(reader, kind, n)
        else:
            raise ValueError(f"a packed column is of kind {kind}, which is not known")
    if reader.left:
        raise ValueError(f"{reader.left} bytes follow the last packed column")
    return np.ascontiguousarray(columns.T)


def _varying(column: FloatArray) -> bytes:
    missing = np.isnan(column)
    known = np.where(missing, 0.0, column)
    # The first values of noise tell that it is of no unit, at a hundredth of the price.
    some = known[:_LOOKED_AT].tolist()
    for unit, size in _UNITS.items():
        if not all(_is_multiple(value, size) for value in some):
            continue
        # What grows to an infinity is not below the limit either.
        with np.errstate(over="ignore"):
            scaled = np.rint(known / size)
        if not np.abs(scaled).max() < _LARGEST:
            continue
        whole = scaled.astype(np.int64)
        # By their bits, as -0.0 would come back as 0.0.
        if np.array_equal((whole * size).view("<u8"), known.view("<u8")):
            return _packed_multiples(whole, missing, unit)
    return bytes([DOUBLES]) + _planes(column.view("<u8"), 8)


def _is_multiple(value: float, size: float) -> bool:
    """Return whether a value may be a whole multiple of a unit; a 0 of either sign may."""
    scaled = value / size
    return abs(scaled) < _LARGEST and round(scaled) * size == value


def _packed_multiples(whole: NDArray[np.int64], missing: NDArray[np.bool_], unit: int) -> bytes:
    kind, mask = WHOLE | unit, b""
    if missing.any():
        kind |= _MISSING
        mask = np.packbits(missing).tobytes()
    changes = np.diff(whole, prepend=0)
    # Counters have small changes; the changes of noise are larger than the noise.
    if np.abs(changes).sum(dtype=np.float64) < np.abs(whole).sum(dtype=np.float64):
        kind |= _CHANGES
        whole = changes
    # The sign becomes the lowest bit, so that small numbers of either sign have few planes.
    unsigned = ((whole << 1) ^ (whole >> 63)).view(np.uint64)
    width = (int(unsigned.max()).bit_length() + 7) // 8
    return bytes([kind]) + mask + bytes([width]) + _planes(unsigned, width)


def _multiples(reader: "_Bytes", kind: int, n: int) -> FloatArray:
    size = _UNITS.get(kind & (_MILLISECONDS | _NANOSECONDS))
    if size is None:
        raise ValueError(f"a packed column is of kind {kind}, which is not known")
    gaps = reader.take((n + 7) // 8) if kind & _MISSING else b""
    width = reader.take(1)[0]
    if width > 8:
        raise ValueError(f"a packed column has numbers of {width} bytes")
    unsigned = _joined(reader.take(width * n), width, n)
    whole = (unsigned >> np.uint64(1)).view(np.int64) ^ -(unsigned & np.uint64(1)).view(np.int64)
    if kind & _CHANGES:
        whole = np.cumsum(whole)
    values: FloatArray = whole * np.float64(size)
    if gaps:
        values[np.unpackbits(np.frombuffer(gaps, "u1"), count=n).astype(bool)] = np.nan
    return values


def _planes(numbers: NDArray[np.uint64], width: int) -> bytes:
    """Return the lowest `width` bytes of numbers (n,): first the lowest of all, and so on."""
    of_each = np.ascontiguousarray(numbers, dtype="<u8").view("u1").reshape(-1, 8)
    return of_each[:, :width].T.tobytes()


def _joined(planes: bytes, width: int, n: int) -> NDArray[np.uint64]:
    """Return the numbers (n,) of which `_planes` made these bytes."""
    of_each = np.zeros((n, 8), "u1")
    of_each[:, :width] = np.frombuffer(planes, "u1").reshape(width, n).T
    return of_each.view("<u8").reshape(n)


class _Bytes:
    """A block of bytes that is taken piece by piece."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        """Number of bytes that were not taken yet."""
        return len(self._data) - self._at

    def take(self, count: int) -> bytes:
        """Return the next bytes.

        Raises:
            ValueError: there are not so many.
        """
        if count > self.left:
            raise ValueError("a packed column is cut off")
        self._at += count
        return self._data[self._at - count : self._at]
