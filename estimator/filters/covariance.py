"""Kalman step of the thesis filters, written out entry by entry while it is compiled.

The model fixes which entries of the transition Jacobian A may differ from zero (eqs. 4.19 and
6.20). The compiler runs `_propagate`, `_correct` and `_store` on numbers that write instructions
down (`_Emitted`), so that their loops become straight-line code for eqs. 4.17 and 4.18 without the
products with zero. Products are fused multiply-adds by name, so that no compiler decides about
rounding. Only the upper triangle of P is read and both triangles are stored equal: an
unsymmetrised P breaks down within some hundred steps under the forward-Euler mode of the oil
column.

Between these three functions P is a tuple of the upper triangle's rows: `P[i][j - i]` is the entry
(i, j). The order in which they compute the entries does not matter for the result, but for the
speed, as the compiler mostly keeps it.
"""

import operator
from functools import partialmethod
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numpy.typing import NDArray

from rig.lanes import everywhere, intrinsic, lanes
from rig.plant import inlined

from .fused import INTERPRETED, emit_fma, fma

Array = NDArray[np.float64]
Vector = tuple[float, ...]
# Typed as Any: by numba's annotations, its elements could not be asked for.
_TUPLE: Final[Any] = types.BaseTuple

COLUMNS: Final = {
    6: ((5,), (0, 1, 3, 4), (0, 2, 3, 4), (4,), (1, 2, 4), (0, 5)),
    7: ((5,), (0, 1, 3, 4), (0, 2, 3, 4), (4,), (1, 2, 6), (0, 5), ()),
}
"""For each row of A, the columns of the entries that are neither zero nor one, by the number of
states (eqs. 4.19 and 6.20). A diagonal entry that is not among them is one."""

_ORDER: Final = (1, 2, 4, 0, 3, 5, 6)
"""The rows of A, those with many entries first, so that the short ones serve as right factors."""


class _Emitted:
    """A number of the code that is being compiled: arithmetic with it writes instructions down."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder, self.value = builder, value

    def _by(self, instruction: str, *others: "_Emitted") -> "_Emitted":
        emit = getattr(self._builder, instruction)
        return _Emitted(self._builder, emit(self.value, *(other.value for other in others)))

    __add__ = partialmethod(_by, "fadd")
    __sub__ = partialmethod(_by, "fsub")
    __mul__ = partialmethod(_by, "fmul")
    __neg__ = partialmethod(_by, "fneg")

    def __rtruediv__(self, number: float) -> "_Emitted":
        constant = ir.Constant(self.value.type, number)
        return _Emitted(self._builder, self._builder.fdiv(constant, self.value))

    def fma(self, b: "_Emitted", c: "_Emitted") -> "_Emitted":
        """Return this number times b, plus c, rounded once."""
        return _Emitted(self._builder, emit_fma(self._builder, self.value, b.value, c.value))


class _EmittedArray:
    """An array of floats or lanes in the code that is being compiled.

    Reading or setting an element, by one constant index or a pair, writes instructions down.
    """

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        self._context, self._builder, self._kind, self._array = context, builder, kind, array

    def _call(self, function: Any, index: Any, *numbers: _Emitted) -> Any:
        context, place = self._context, typeof(index)
        kinds = self._kind, place, *(_element(self._kind) for _ in numbers)
        kind = context.typing_context.resolve_value_type(function)
        signature = kind.get_call_type(context.typing_context, kinds, {})
        call = context.get_function(kind, signature)
        context.add_linking_libs(getattr(call, "libs", ()))
        at = context.get_constant_generic(self._builder, place, index)
        return call(self._builder, (self._array, at, *(number.value for number in numbers)))

    def __getitem__(self, index: Any) -> _Emitted:
        return _Emitted(self._builder, self._call(operator.getitem, index))

    def __setitem__(self, index: Any, number: _Emitted) -> None:
        self._call(operator.setitem, index, number)


def _element(array: Any) -> Any:
    """Return the numba type of an array's elements: float64 or lanes."""
    return types.float64 if isinstance(array, types.Array) else lanes


def _opened(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return a compiled value, of the numba type `kind`, in a form with which Python can compute.

    That is an `_Emitted`, an `_EmittedArray`, a literal integer, or a tuple of these.
    """
    if isinstance(kind, _TUPLE):
        parts = zip(kind, cgutils.unpack_tuple(builder, value), strict=True)
        return tuple(_opened(context, builder, *part) for part in parts)
    if isinstance(kind, types.IntegerLiteral):
        return kind.literal_value
    if kind in (types.float64, lanes):
        return _Emitted(builder, value)
    return _EmittedArray(context, builder, kind, value)


def _packed(context: Any, builder: Any, kind: Any, result: Any) -> Any:
    """Return a result as a compiled value of the numba type `kind`; this undoes `_opened`.

    The result is an `_Emitted`, a tuple of these, or None for a function that returns nothing.
    """
    if isinstance(kind, _TUPLE):
        parts = zip(kind, result, strict=True)
        return context.make_tuple(builder, kind, [_packed(context, builder, *p) for p in parts])
    return context.get_dummy_value() if result is None else result.value


def _written_out(function: Any, signature: Any) -> Any:
    """Return what numba's `intrinsic` asks for: the signature, and a function that emits the code.

    The code consists of the instructions that `function` writes down when it is called with the
    arguments in the form of `_opened`.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = zip(signature.args, arguments, strict=True)
        result = function(*(_opened(context, builder, *each) for each in given))
        return _packed(context, builder, signature.return_type, result)

    return signature, emit


def _fma(a: Any, b: Any, c: Any) -> Any:
    return a.fma(b, c) if isinstance(a, _Emitted) else fma(a, b, c)


def _entry(P: Any, i: int, j: int) -> Any:
    return P[min(i, j)][abs(i - j)]


def _upper(entries: Any, n: int) -> Any:
    """Return the rows of the upper triangle of a symmetric matrix (n, n), in tuples.

    `entries` is a dictionary that has each entry under (i, j) or under (j, i).
    """
    return tuple(
        tuple(entries[i, j] if (i, j) in entries else entries[j, i] for j in range(i, n))
        for i in range(n)
    )


def _row_times(row: dict[int, Any], i: int, vector: Any, total: Any = None) -> Any:
    """Return row i of A times a vector (n,), plus `total` if there is one.

    `row` has the entries of the row that are neither zero nor one by their columns.
    """
    if i not in row:
        total = vector[i] if total is None else total + vector[i]
    for j, entry in row.items():
        total = entry * vector[j] if total is None else _fma(entry, vector[j], total)
    return total


def _propagate(entries: Any, P: Any, noise: Any) -> Any:
    """Return the rows of the upper triangle of A P A' + Q (eq. 4.17), in tuples.

    Args:
        entries: entries of A at `COLUMNS`, row by row.
        P: array (n, n), of which the upper triangle is read.
        noise: diagonal of Q, n numbers.
    """
    n, left = len(noise), iter(entries)
    rows = [{j: next(left) for j in columns} for columns in COLUMNS[n]]
    old = [[P[i, j] for j in range(i, n)] for i in range(n)]
    order = [i for i in _ORDER if i < n]
    product = {
        i: [_row_times(rows[i], i, [_entry(old, j, k) for j in range(n)]) for k in range(n)]
        for i in order
    }
    new = {
        (i, j): _row_times(rows[j], j, product[i], noise[i] if i == j else None)
        for place, i in enumerate(order)
        for j in order[place:]
    }
    return _upper(new, n)


def _correct(x: Any, P: Any, state: int, z: Any, variance: Any) -> Any:
    """Return the state and its covariance P after the update by one measurement of a state.

    This is eq. 4.18 with a diagonal R. Both are in the form in which they are given.

    Args:
        x: state, n numbers.
        P: covariance of the state, as rows of the upper triangle.
        state: index of the measured state.
        z: the measured value.
        variance: variance of the measurement, from the diagonal of R.
    """
    n = len(x)
    others = [i for i in range(n) if i != state]
    column = [_entry(P, i, state) for i in range(n)]
    inverse = 1.0 / (column[state] + variance)
    deviation = (z - x[state]) * inverse
    corrected = tuple(_fma(column[i], deviation, x[i]) for i in range(n))
    gain = [-covariance * inverse for covariance in column]
    new = {
        (i, j): _fma(gain[i], column[j], _entry(P, i, j)) for i in others for j in others if j >= i
    }
    # 1 - K is computed as R/S, which avoids the cancellation in P - K P.
    kept = variance * inverse
    new.update({(i, state): column[i] * kept for i in range(n)})
    return corrected, _upper(new, n)


def _store(x: Any, P: Any, x_out: Any, P_out: Any) -> None:
    """Write the state and both triangles of P into the arrays (n,) and (n, n)."""
    n = len(x)
    for i in range(n):
        x_out[i] = x[i]
    for i in range(n):
        for j in range(i, n):
            P_out[i, j] = P_out[j, i] = P[i][j - i]


@intrinsic
def _propagated(typing_context, entries, P, noise):
    kind, n = _element(P), len(noise)
    upper = types.Tuple([types.UniTuple(kind, n - i) for i in range(n)])
    signature = upper(types.UniTuple(kind, len(entries)), P, types.UniTuple(kind, n))
    return _written_out(_propagate, signature)


@intrinsic(prefer_literal=True)
def _corrected(typing_context, x, P, state, z, variance):
    return _written_out(_correct, types.Tuple((x, P))(x, P, state, x.dtype, x.dtype))


@intrinsic
def _stored(typing_context, x, P, x_out, P_out):
    return _written_out(_store, types.void(x, P, x_out, P_out))


if INTERPRETED:
    _propagated, _corrected, _stored = _propagate, _correct, _store


@inlined
def kalman_step(
    linearised: tuple[Vector, Vector],
    x: Array,
    P: Array,
    noise: tuple[Vector, Vector],
    measured: Vector,
    out: Array,
) -> None:
    """Advance the state x (n,) and its covariance P (n, n) by one sample, in place; n is 6 or 7.

    P is propagated; then both are corrected by the readings, one after the other.

    Args:
        linearised: the predicted state x(-), n numbers, and the entries at `COLUMNS` of the
            Jacobian of this prediction, row by row.
        x: overwritten with the corrected state; its old content is not read.
        P: covariance of the state before the sample, updated.
        noise: diagonal of Q, n numbers, and that of R in the order position, p1, p2.
        measured: position in m, p1 and p2 in Pa. A NaN is skipped; where these are lanes, a NaN in
            one lane skips the reading in all.
        out: (9,), overwritten: 0 to 2 the innovations, 3 to 5 the residuals after the correction,
            6 to 8 the innovation variances, each of position, p1, p2; NaN for a skipped reading.
    """
    state, entries = linearised
    process_noise, measurement_noise = noise
    position, p1, p2 = measured
    upper = _propagated(entries, P, process_noise)
    out[0] = position - state[3]
    out[1] = p1 - state[1]
    out[2] = p2 - state[2]
    out[6] = upper[3][0] + measurement_noise[0] if everywhere(position == position) else np.nan
    out[7] = upper[1][0] + measurement_noise[1] if everywhere(p1 == p1) else np.nan
    out[8] = upper[2][0] + measurement_noise[2] if everywhere(p2 == p2) else np.nan
    if everywhere(position == position):
        state, upper = _corrected(state, upper, 3, position, measurement_noise[0])
    if everywhere(p1 == p1):
        state, upper = _corrected(state, upper, 1, p1, measurement_noise[1])
    if everywhere(p2 == p2):
        state, upper = _corrected(state, upper, 2, p2, measurement_noise[2])
    out[3] = position - state[3]
    out[4] = p1 - state[1]
    out[5] = p2 - state[2]
    _stored(state, upper, x, P)
