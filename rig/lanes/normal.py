"""Standard normal random numbers, with an independent stream in each lane.

Uniform numbers come from xoshiro256++ (Blackman and Vigna 2021), seeded by numpy's SeedSequence,
and become normal by the formula of Box and Muller (1958). Its logarithm, sine and cosine are series
here, accurate to 1e-9, as the C library takes only one number at a time.
"""

import math
from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np
from llvmlite import ir
from numba import types
from numpy.typing import NDArray

from rig.jit import njit

from .choosing import select
from .kinds import BITS, LANES, VECTOR, intrinsic, lanes
from .memory import load, store
from .sines import sine_and_cosine

_WORDS: Final = 4
_UNIT: Final = 2.0**-53
_EXPONENT_AT: Final = 52
_MANTISSA: Final = 2**_EXPONENT_AT - 1
_BIAS: Final = 1023
_LN_2: Final = math.log(2.0)
_SQRT_2: Final = math.sqrt(2.0)


def start_streams(seeds: Sequence[int]) -> NDArray[np.uint64]:
    """Return the start state (4, LANES) of the streams of normal numbers, one seed for each lane.

    Raises:
        ValueError: the number of seeds is not `LANES`.
    """
    if len(seeds) != LANES:
        raise ValueError(f"normal numbers: {len(seeds)} seeds for {LANES} lanes")
    words = [np.random.SeedSequence(seed).generate_state(_WORDS, np.uint64) for seed in seeds]
    return np.ascontiguousarray(np.transpose(words))


@njit(cache=True, error_model="numpy")
def _fill_uniform(state, numbers):
    """Fill an array (n, LANES) with uniform numbers above 0 and up to 1, and update `state`.

    The numbers are (k + 1/2) / 2^53, rounded to float64, with k drawn from 0 to 2^53 - 1.
    """
    for i in range(numbers.shape[0]):
        for lane in range(LANES):
            a, b, c, d = state[0, lane], state[1, lane], state[2, lane], state[3, lane]
            total = a + d
            word = ((total << np.uint64(23)) | (total >> np.uint64(41))) + a
            shifted = b << np.uint64(17)
            c ^= a
            d ^= b
            b ^= c
            a ^= d
            c ^= shifted
            d = (d << np.uint64(45)) | (d >> np.uint64(19))
            state[0, lane], state[1, lane], state[2, lane], state[3, lane] = a, b, c, d
            numbers[i, lane] = (np.float64(word >> np.uint64(11)) + 0.5) * _UNIT


@intrinsic
def _split(typing_context, number):
    """Return n and m of positive numbers 2^n m, 1 <= m < 2; the numbers must not be denormal."""

    def emit(context, builder, signature, arguments):
        def constant(value: int) -> ir.Constant:
            return ir.Constant(BITS, [value] * LANES)

        bits = builder.bitcast(arguments[0], BITS)
        biased = builder.lshr(bits, constant(_EXPONENT_AT))
        exponent = builder.sitofp(builder.sub(biased, constant(_BIAS)), VECTOR)
        mantissa = builder.and_(bits, constant(_MANTISSA))
        mantissa = builder.or_(mantissa, constant(_BIAS << _EXPONENT_AT))
        parts = (exponent, builder.bitcast(mantissa, VECTOR))
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(lanes, 2)(lanes), emit


@njit(cache=True, error_model="numpy", forceinline=True)
def _logarithm(number):
    """Return the natural logarithm of numbers in (0, 1), by the series of artanh."""
    exponent, mantissa = _split(number)
    large = mantissa > _SQRT_2
    mantissa = select(large, 0.5 * mantissa, mantissa)
    exponent = select(large, exponent + 1.0, exponent)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    q = s * s
    series = 1 + q * (1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q * (1 / 11)))))
    return exponent * _LN_2 + 2.0 * s * series


@njit(cache=True, error_model="numpy", nogil=True)
def fill_normal(state, numbers):
    """Fill a float64 array (n, LANES), n even, with standard normal numbers.

    A stream gives the same numbers in the same order whatever the (even) sizes of the arrays.

    Args:
        state: uint64 (4, LANES), made by `start_streams`; updated.
        numbers: the array, C-contiguous.
    """
    _fill_uniform(state, numbers)
    for i in range(0, numbers.shape[0], 2):
        radius = sqrt(-2.0 * _logarithm(load(numbers, i)))
        sine, cosine = sine_and_cosine(load(numbers, i + 1))
        store(numbers, i, radius * cosine)
        store(numbers, i + 1, radius * sine)
