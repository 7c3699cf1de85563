"""The function e^x on lanes, by arithmetic alone, as the C library takes only one number at a time.

e^x = 2^n e^r with n the integer nearest to x / ln 2. e^r is Taylor's series up to r^13, whose
remainder is 4e-18 for |r| <= ln 2 / 2. The result is within 2 units in the last place.
"""

import math
from typing import Final

from llvmlite import ir

from .choosing import INLINED
from .kinds import BITS, LANES, VECTOR, intrinsic, lanes, overload

_LOG2_E: Final = 1.0 / math.log(2.0)
# ln 2 in two parts (Cody and Waite 1980). The first has 32 bits, so that n times it is exact.
_LN2_HIGH: Final = 6.93147180369123816490e-01
_LN2_LOW: Final = 1.90821492927058770002e-10
_LEAST: Final = -708.0
"""Least argument; below it, the result is e^-708 = 3e-308."""
_ROUNDING: Final = 1.5 * 2.0**52
"""A number that, added to a number below 2^51, makes a sum with the nearest integer in its last
bits."""
_EXPONENT_AT: Final = 52
"""Index of the lowest bit of a float64's exponent."""


@intrinsic
def _times_power_of_two(typing_context, number, rounded):
    """Return number * 2^n, where `rounded` is n + `_ROUNDING`.

    Neither the number nor the result may be denormal or infinite.
    """

    def emit(context, builder, signature, arguments):
        number, rounded = (builder.bitcast(argument, BITS) for argument in arguments)
        power = builder.shl(rounded, ir.Constant(BITS, [_EXPONENT_AT] * LANES))
        return builder.bitcast(builder.add(number, power), VECTOR)

    return lanes(lanes, lanes), emit


@overload(math.exp, jit_options=INLINED)
def _exp(x):
    if x != lanes:
        return None

    def exp(x):
        x = max(x, _LEAST)
        rounded = x * _LOG2_E + _ROUNDING
        n = rounded - _ROUNDING
        r = (x - n * _LN2_HIGH) - n * _LN2_LOW
        # Estrin's scheme, whose terms the processor can compute at the same time.
        r2 = r * r
        r4 = r2 * r2
        low = (1.0 + r) + r2 * (1 / 2 + r * (1 / 6))
        middle = (1 / 24 + r * (1 / 120)) + r2 * (1 / 720 + r * (1 / 5040))
        high = (1 / 40320 + r * (1 / 362880)) + r2 * (1 / 3628800 + r * (1 / 39916800))
        last = 1 / 479001600 + r * (1 / 6227020800)
        return _times_power_of_two(low + r4 * (middle + r4 * (high + r4 * last)), rounded)

    return exp
