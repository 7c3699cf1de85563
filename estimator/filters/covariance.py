"""Straight-line covariance steps of the thesis filters: written by a program, not by hand.

Change `tools/generate_covariance.py` and run `python -m tools.generate_covariance`.
Products are fused multiply-adds by name, so that no compiler decides about rounding. Only the
upper triangle of P is read and both triangles are stored equal: an unsymmetrised P breaks down
within some hundred steps under the forward-Euler mode of the oil column.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import everywhere

from .fused import fma

FloatArray = NDArray[np.float64]
Vector = tuple[float, ...]

# Row and column of every Jacobian entry that is neither zero nor one, in the order of `entries`.
THESIS6_ENTRIES: Final = (
    (0, 5),
    (1, 0),
    (1, 1),
    (1, 3),
    (1, 4),
    (2, 0),
    (2, 2),
    (2, 3),
    (2, 4),
    (3, 4),
    (4, 1),
    (4, 2),
    (4, 4),
    (5, 0),
    (5, 5),
)
THESIS7_ENTRIES: Final = (
    (0, 5),
    (1, 0),
    (1, 1),
    (1, 3),
    (1, 4),
    (2, 0),
    (2, 2),
    (2, 3),
    (2, 4),
    (3, 4),
    (4, 1),
    (4, 2),
    (4, 6),
    (5, 0),
    (5, 5),
)


@njit(cache=True, error_model="numpy", forceinline=True)
def thesis6_kalman_step(
    predicted: Vector,
    entries: Vector,
    x: FloatArray,
    P: FloatArray,
    process_noise: Vector,
    measurement_noise: Vector,
    z_position: float,
    z_p1: float,
    z_p2: float,
    out: FloatArray,
) -> None:
    """Propagate and correct x (6,) and P (6, 6) by one sample, both in place.

    `predicted` is x(-) and `entries` the Jacobian of eq. 4.19 in the order of
    `THESIS6_ENTRIES`. `out` (9,) as in `estimator.filters.thesis`.
    """
    x0, x1, x2, x3, x4, x5 = predicted
    a05, a10, a11, a13, a14, a20, a22, a23, a24, a34, a41, a42, a44, a50, a55 = entries
    p00 = P[0, 0]
    p01 = P[0, 1]
    p02 = P[0, 2]
    p03 = P[0, 3]
    p04 = P[0, 4]
    p05 = P[0, 5]
    p11 = P[1, 1]
    p12 = P[1, 2]
    p13 = P[1, 3]
    p14 = P[1, 4]
    p15 = P[1, 5]
    p22 = P[2, 2]
    p23 = P[2, 3]
    p24 = P[2, 4]
    p25 = P[2, 5]
    p33 = P[3, 3]
    p34 = P[3, 4]
    p35 = P[3, 5]
    p44 = P[4, 4]
    p45 = P[4, 5]
    p55 = P[5, 5]
    m10 = fma(a14, p04, fma(a13, p03, fma(a11, p01, a10 * p00)))
    m11 = fma(a14, p14, fma(a13, p13, fma(a11, p11, a10 * p01)))
    m12 = fma(a14, p24, fma(a13, p23, fma(a11, p12, a10 * p02)))
    m13 = fma(a14, p34, fma(a13, p33, fma(a11, p13, a10 * p03)))
    m14 = fma(a14, p44, fma(a13, p34, fma(a11, p14, a10 * p04)))
    m15 = fma(a14, p45, fma(a13, p35, fma(a11, p15, a10 * p05)))
    m20 = fma(a24, p04, fma(a23, p03, fma(a22, p02, a20 * p00)))
    m21 = fma(a24, p14, fma(a23, p13, fma(a22, p12, a20 * p01)))
    m22 = fma(a24, p24, fma(a23, p23, fma(a22, p22, a20 * p02)))
    m23 = fma(a24, p34, fma(a23, p33, fma(a22, p23, a20 * p03)))
    m24 = fma(a24, p44, fma(a23, p34, fma(a22, p24, a20 * p04)))
    m25 = fma(a24, p45, fma(a23, p35, fma(a22, p25, a20 * p05)))
    m40 = fma(a44, p04, fma(a42, p02, a41 * p01))
    m41 = fma(a44, p14, fma(a42, p12, a41 * p11))
    m42 = fma(a44, p24, fma(a42, p22, a41 * p12))
    m43 = fma(a44, p34, fma(a42, p23, a41 * p13))
    m44 = fma(a44, p44, fma(a42, p24, a41 * p14))
    m45 = fma(a44, p45, fma(a42, p25, a41 * p15))
    m00 = fma(a05, p05, p00)
    m03 = fma(a05, p35, p03)
    m04 = fma(a05, p45, p04)
    m05 = fma(a05, p55, p05)
    m30 = fma(a34, p04, p03)
    m33 = fma(a34, p34, p33)
    m34 = fma(a34, p44, p34)
    m35 = fma(a34, p45, p35)
    m50 = fma(a55, p05, a50 * p00)
    m55 = fma(a55, p55, a50 * p05)
    p11 = fma(a14, m14, fma(a13, m13, fma(a11, m11, fma(a10, m10, process_noise[1]))))
    p12 = fma(a24, m14, fma(a23, m13, fma(a22, m12, a20 * m10)))
    p14 = fma(a44, m14, fma(a42, m12, a41 * m11))
    p01 = fma(a05, m15, m10)
    p13 = fma(a34, m14, m13)
    p15 = fma(a55, m15, a50 * m10)
    p22 = fma(a24, m24, fma(a23, m23, fma(a22, m22, fma(a20, m20, process_noise[2]))))
    p24 = fma(a44, m24, fma(a42, m22, a41 * m21))
    p02 = fma(a05, m25, m20)
    p23 = fma(a34, m24, m23)
    p25 = fma(a55, m25, a50 * m20)
    p44 = fma(a44, m44, fma(a42, m42, fma(a41, m41, process_noise[4])))
    p04 = fma(a05, m45, m40)
    p34 = fma(a34, m44, m43)
    p45 = fma(a55, m45, a50 * m40)
    p00 = fma(a05, m05, process_noise[0] + m00)
    p03 = fma(a34, m04, m03)
    p05 = fma(a55, m05, a50 * m00)
    p33 = fma(a34, m34, process_noise[3] + m33)
    p35 = fma(a55, m35, a50 * m30)
    p55 = fma(a55, m55, fma(a50, m50, process_noise[5]))
    out[0] = z_position - x3
    out[1] = z_p1 - x1
    out[2] = z_p2 - x2
    out[6] = p33 + measurement_noise[0] if everywhere(z_position == z_position) else np.nan
    out[7] = p11 + measurement_noise[1] if everywhere(z_p1 == z_p1) else np.nan
    out[8] = p22 + measurement_noise[2] if everywhere(z_p2 == z_p2) else np.nan
    if everywhere(z_position == z_position):
        inverse = 1.0 / (p33 + measurement_noise[0])
        deviation = (z_position - x3) * inverse
        x0 = fma(p03, deviation, x0)
        x1 = fma(p13, deviation, x1)
        x2 = fma(p23, deviation, x2)
        x3 = fma(p33, deviation, x3)
        x4 = fma(p34, deviation, x4)
        x5 = fma(p35, deviation, x5)
        k0 = -p03 * inverse
        k1 = -p13 * inverse
        k2 = -p23 * inverse
        k4 = -p34 * inverse
        k5 = -p35 * inverse
        p00 = fma(k0, p03, p00)
        p01 = fma(k0, p13, p01)
        p02 = fma(k0, p23, p02)
        p04 = fma(k0, p34, p04)
        p05 = fma(k0, p35, p05)
        p11 = fma(k1, p13, p11)
        p12 = fma(k1, p23, p12)
        p14 = fma(k1, p34, p14)
        p15 = fma(k1, p35, p15)
        p22 = fma(k2, p23, p22)
        p24 = fma(k2, p34, p24)
        p25 = fma(k2, p35, p25)
        p44 = fma(k4, p34, p44)
        p45 = fma(k4, p35, p45)
        p55 = fma(k5, p35, p55)
        kept = measurement_noise[0] * inverse
        p03 = p03 * kept
        p13 = p13 * kept
        p23 = p23 * kept
        p33 = p33 * kept
        p34 = p34 * kept
        p35 = p35 * kept
    if everywhere(z_p1 == z_p1):
        inverse = 1.0 / (p11 + measurement_noise[1])
        deviation = (z_p1 - x1) * inverse
        x0 = fma(p01, deviation, x0)
        x1 = fma(p11, deviation, x1)
        x2 = fma(p12, deviation, x2)
        x3 = fma(p13, deviation, x3)
        x4 = fma(p14, deviation, x4)
        x5 = fma(p15, deviation, x5)
        k0 = -p01 * inverse
        k2 = -p12 * inverse
        k3 = -p13 * inverse
        k4 = -p14 * inverse
        k5 = -p15 * inverse
        p00 = fma(k0, p01, p00)
        p02 = fma(k0, p12, p02)
        p03 = fma(k0, p13, p03)
        p04 = fma(k0, p14, p04)
        p05 = fma(k0, p15, p05)
        p22 = fma(k2, p12, p22)
        p23 = fma(k2, p13, p23)
        p24 = fma(k2, p14, p24)
        p25 = fma(k2, p15, p25)
        p33 = fma(k3, p13, p33)
        p34 = fma(k3, p14, p34)
        p35 = fma(k3, p15, p35)
        p44 = fma(k4, p14, p44)
        p45 = fma(k4, p15, p45)
        p55 = fma(k5, p15, p55)
        kept = measurement_noise[1] * inverse
        p01 = p01 * kept
        p11 = p11 * kept
        p12 = p12 * kept
        p13 = p13 * kept
        p14 = p14 * kept
        p15 = p15 * kept
    if everywhere(z_p2 == z_p2):
        inverse = 1.0 / (p22 + measurement_noise[2])
        deviation = (z_p2 - x2) * inverse
        x0 = fma(p02, deviation, x0)
        x1 = fma(p12, deviation, x1)
        x2 = fma(p22, deviation, x2)
        x3 = fma(p23, deviation, x3)
        x4 = fma(p24, deviation, x4)
        x5 = fma(p25, deviation, x5)
        k0 = -p02 * inverse
        k1 = -p12 * inverse
        k3 = -p23 * inverse
        k4 = -p24 * inverse
        k5 = -p25 * inverse
        p00 = fma(k0, p02, p00)
        p01 = fma(k0, p12, p01)
        p03 = fma(k0, p23, p03)
        p04 = fma(k0, p24, p04)
        p05 = fma(k0, p25, p05)
        p11 = fma(k1, p12, p11)
        p13 = fma(k1, p23, p13)
        p14 = fma(k1, p24, p14)
        p15 = fma(k1, p25, p15)
        p33 = fma(k3, p23, p33)
        p34 = fma(k3, p24, p34)
        p35 = fma(k3, p25, p35)
        p44 = fma(k4, p24, p44)
        p45 = fma(k4, p25, p45)
        p55 = fma(k5, p25, p55)
        kept = measurement_noise[2] * inverse
        p02 = p02 * kept
        p12 = p12 * kept
        p22 = p22 * kept
        p23 = p23 * kept
        p24 = p24 * kept
        p25 = p25 * kept
    out[3] = z_position - x3
    out[4] = z_p1 - x1
    out[5] = z_p2 - x2
    x[0] = x0
    x[1] = x1
    x[2] = x2
    x[3] = x3
    x[4] = x4
    x[5] = x5
    P[0, 0] = p00
    P[0, 1] = P[1, 0] = p01
    P[0, 2] = P[2, 0] = p02
    P[0, 3] = P[3, 0] = p03
    P[0, 4] = P[4, 0] = p04
    P[0, 5] = P[5, 0] = p05
    P[1, 1] = p11
    P[1, 2] = P[2, 1] = p12
    P[1, 3] = P[3, 1] = p13
    P[1, 4] = P[4, 1] = p14
    P[1, 5] = P[5, 1] = p15
    P[2, 2] = p22
    P[2, 3] = P[3, 2] = p23
    P[2, 4] = P[4, 2] = p24
    P[2, 5] = P[5, 2] = p25
    P[3, 3] = p33
    P[3, 4] = P[4, 3] = p34
    P[3, 5] = P[5, 3] = p35
    P[4, 4] = p44
    P[4, 5] = P[5, 4] = p45
    P[5, 5] = p55


@njit(cache=True, error_model="numpy", forceinline=True)
def thesis7_kalman_step(
    predicted: Vector,
    entries: Vector,
    x: FloatArray,
    P: FloatArray,
    process_noise: Vector,
    measurement_noise: Vector,
    z_position: float,
    z_p1: float,
    z_p2: float,
    out: FloatArray,
) -> None:
    """Propagate and correct x (7,) and P (7, 7) by one sample, both in place.

    `predicted` is x(-) and `entries` the Jacobian of eq. 6.20 in the order of
    `THESIS7_ENTRIES`. `out` (9,) as in `estimator.filters.thesis`.
    """
    x0, x1, x2, x3, x4, x5, x6 = predicted
    a05, a10, a11, a13, a14, a20, a22, a23, a24, a34, a41, a42, a46, a50, a55 = entries
    p00 = P[0, 0]
    p01 = P[0, 1]
    p02 = P[0, 2]
    p03 = P[0, 3]
    p04 = P[0, 4]
    p05 = P[0, 5]
    p06 = P[0, 6]
    p11 = P[1, 1]
    p12 = P[1, 2]
    p13 = P[1, 3]
    p14 = P[1, 4]
    p15 = P[1, 5]
    p16 = P[1, 6]
    p22 = P[2, 2]
    p23 = P[2, 3]
    p24 = P[2, 4]
    p25 = P[2, 5]
    p26 = P[2, 6]
    p33 = P[3, 3]
    p34 = P[3, 4]
    p35 = P[3, 5]
    p36 = P[3, 6]
    p44 = P[4, 4]
    p45 = P[4, 5]
    p46 = P[4, 6]
    p55 = P[5, 5]
    p56 = P[5, 6]
    p66 = P[6, 6]
    m10 = fma(a14, p04, fma(a13, p03, fma(a11, p01, a10 * p00)))
    m11 = fma(a14, p14, fma(a13, p13, fma(a11, p11, a10 * p01)))
    m12 = fma(a14, p24, fma(a13, p23, fma(a11, p12, a10 * p02)))
    m13 = fma(a14, p34, fma(a13, p33, fma(a11, p13, a10 * p03)))
    m14 = fma(a14, p44, fma(a13, p34, fma(a11, p14, a10 * p04)))
    m15 = fma(a14, p45, fma(a13, p35, fma(a11, p15, a10 * p05)))
    m16 = fma(a14, p46, fma(a13, p36, fma(a11, p16, a10 * p06)))
    m20 = fma(a24, p04, fma(a23, p03, fma(a22, p02, a20 * p00)))
    m21 = fma(a24, p14, fma(a23, p13, fma(a22, p12, a20 * p01)))
    m22 = fma(a24, p24, fma(a23, p23, fma(a22, p22, a20 * p02)))
    m23 = fma(a24, p34, fma(a23, p33, fma(a22, p23, a20 * p03)))
    m24 = fma(a24, p44, fma(a23, p34, fma(a22, p24, a20 * p04)))
    m25 = fma(a24, p45, fma(a23, p35, fma(a22, p25, a20 * p05)))
    m26 = fma(a24, p46, fma(a23, p36, fma(a22, p26, a20 * p06)))
    m40 = fma(a46, p06, fma(a42, p02, fma(a41, p01, p04)))
    m41 = fma(a46, p16, fma(a42, p12, fma(a41, p11, p14)))
    m42 = fma(a46, p26, fma(a42, p22, fma(a41, p12, p24)))
    m43 = fma(a46, p36, fma(a42, p23, fma(a41, p13, p34)))
    m44 = fma(a46, p46, fma(a42, p24, fma(a41, p14, p44)))
    m45 = fma(a46, p56, fma(a42, p25, fma(a41, p15, p45)))
    m46 = fma(a46, p66, fma(a42, p26, fma(a41, p16, p46)))
    m00 = fma(a05, p05, p00)
    m03 = fma(a05, p35, p03)
    m04 = fma(a05, p45, p04)
    m05 = fma(a05, p55, p05)
    m06 = fma(a05, p56, p06)
    m30 = fma(a34, p04, p03)
    m33 = fma(a34, p34, p33)
    m34 = fma(a34, p44, p34)
    m35 = fma(a34, p45, p35)
    m36 = fma(a34, p46, p36)
    m50 = fma(a55, p05, a50 * p00)
    m55 = fma(a55, p55, a50 * p05)
    m56 = fma(a55, p56, a50 * p06)
    m66 = p66
    p11 = fma(a14, m14, fma(a13, m13, fma(a11, m11, fma(a10, m10, process_noise[1]))))
    p12 = fma(a24, m14, fma(a23, m13, fma(a22, m12, a20 * m10)))
    p14 = fma(a46, m16, fma(a42, m12, fma(a41, m11, m14)))
    p01 = fma(a05, m15, m10)
    p13 = fma(a34, m14, m13)
    p15 = fma(a55, m15, a50 * m10)
    p16 = m16
    p22 = fma(a24, m24, fma(a23, m23, fma(a22, m22, fma(a20, m20, process_noise[2]))))
    p24 = fma(a46, m26, fma(a42, m22, fma(a41, m21, m24)))
    p02 = fma(a05, m25, m20)
    p23 = fma(a34, m24, m23)
    p25 = fma(a55, m25, a50 * m20)
    p26 = m26
    p44 = fma(a46, m46, fma(a42, m42, fma(a41, m41, process_noise[4] + m44)))
    p04 = fma(a05, m45, m40)
    p34 = fma(a34, m44, m43)
    p45 = fma(a55, m45, a50 * m40)
    p46 = m46
    p00 = fma(a05, m05, process_noise[0] + m00)
    p03 = fma(a34, m04, m03)
    p05 = fma(a55, m05, a50 * m00)
    p06 = m06
    p33 = fma(a34, m34, process_noise[3] + m33)
    p35 = fma(a55, m35, a50 * m30)
    p36 = m36
    p55 = fma(a55, m55, fma(a50, m50, process_noise[5]))
    p56 = m56
    p66 = process_noise[6] + m66
    out[0] = z_position - x3
    out[1] = z_p1 - x1
    out[2] = z_p2 - x2
    out[6] = p33 + measurement_noise[0] if everywhere(z_position == z_position) else np.nan
    out[7] = p11 + measurement_noise[1] if everywhere(z_p1 == z_p1) else np.nan
    out[8] = p22 + measurement_noise[2] if everywhere(z_p2 == z_p2) else np.nan
    if everywhere(z_position == z_position):
        inverse = 1.0 / (p33 + measurement_noise[0])
        deviation = (z_position - x3) * inverse
        x0 = fma(p03, deviation, x0)
        x1 = fma(p13, deviation, x1)
        x2 = fma(p23, deviation, x2)
        x3 = fma(p33, deviation, x3)
        x4 = fma(p34, deviation, x4)
        x5 = fma(p35, deviation, x5)
        x6 = fma(p36, deviation, x6)
        k0 = -p03 * inverse
        k1 = -p13 * inverse
        k2 = -p23 * inverse
        k4 = -p34 * inverse
        k5 = -p35 * inverse
        k6 = -p36 * inverse
        p00 = fma(k0, p03, p00)
        p01 = fma(k0, p13, p01)
        p02 = fma(k0, p23, p02)
        p04 = fma(k0, p34, p04)
        p05 = fma(k0, p35, p05)
        p06 = fma(k0, p36, p06)
        p11 = fma(k1, p13, p11)
        p12 = fma(k1, p23, p12)
        p14 = fma(k1, p34, p14)
        p15 = fma(k1, p35, p15)
        p16 = fma(k1, p36, p16)
        p22 = fma(k2, p23, p22)
        p24 = fma(k2, p34, p24)
        p25 = fma(k2, p35, p25)
        p26 = fma(k2, p36, p26)
        p44 = fma(k4, p34, p44)
        p45 = fma(k4, p35, p45)
        p46 = fma(k4, p36, p46)
        p55 = fma(k5, p35, p55)
        p56 = fma(k5, p36, p56)
        p66 = fma(k6, p36, p66)
        kept = measurement_noise[0] * inverse
        p03 = p03 * kept
        p13 = p13 * kept
        p23 = p23 * kept
        p33 = p33 * kept
        p34 = p34 * kept
        p35 = p35 * kept
        p36 = p36 * kept
    if everywhere(z_p1 == z_p1):
        inverse = 1.0 / (p11 + measurement_noise[1])
        deviation = (z_p1 - x1) * inverse
        x0 = fma(p01, deviation, x0)
        x1 = fma(p11, deviation, x1)
        x2 = fma(p12, deviation, x2)
        x3 = fma(p13, deviation, x3)
        x4 = fma(p14, deviation, x4)
        x5 = fma(p15, deviation, x5)
        x6 = fma(p16, deviation, x6)
        k0 = -p01 * inverse
        k2 = -p12 * inverse
        k3 = -p13 * inverse
        k4 = -p14 * inverse
        k5 = -p15 * inverse
        k6 = -p16 * inverse
        p00 = fma(k0, p01, p00)
        p02 = fma(k0, p12, p02)
        p03 = fma(k0, p13, p03)
        p04 = fma(k0, p14, p04)
        p05 = fma(k0, p15, p05)
        p06 = fma(k0, p16, p06)
        p22 = fma(k2, p12, p22)
        p23 = fma(k2, p13, p23)
        p24 = fma(k2, p14, p24)
        p25 = fma(k2, p15, p25)
        p26 = fma(k2, p16, p26)
        p33 = fma(k3, p13, p33)
        p34 = fma(k3, p14, p34)
        p35 = fma(k3, p15, p35)
        p36 = fma(k3, p16, p36)
        p44 = fma(k4, p14, p44)
        p45 = fma(k4, p15, p45)
        p46 = fma(k4, p16, p46)
        p55 = fma(k5, p15, p55)
        p56 = fma(k5, p16, p56)
        p66 = fma(k6, p16, p66)
        kept = measurement_noise[1] * inverse
        p01 = p01 * kept
        p11 = p11 * kept
        p12 = p12 * kept
        p13 = p13 * kept
        p14 = p14 * kept
        p15 = p15 * kept
        p16 = p16 * kept
    if everywhere(z_p2 == z_p2):
        inverse = 1.0 / (p22 + measurement_noise[2])
        deviation = (z_p2 - x2) * inverse
        x0 = fma(p02, deviation, x0)
        x1 = fma(p12, deviation, x1)
        x2 = fma(p22, deviation, x2)
        x3 = fma(p23, deviation, x3)
        x4 = fma(p24, deviation, x4)
        x5 = fma(p25, deviation, x5)
        x6 = fma(p26, deviation, x6)
        k0 = -p02 * inverse
        k1 = -p12 * inverse
        k3 = -p23 * inverse
        k4 = -p24 * inverse
        k5 = -p25 * inverse
        k6 = -p26 * inverse
        p00 = fma(k0, p02, p00)
        p01 = fma(k0, p12, p01)
        p03 = fma(k0, p23, p03)
        p04 = fma(k0, p24, p04)
        p05 = fma(k0, p25, p05)
        p06 = fma(k0, p26, p06)
        p11 = fma(k1, p12, p11)
        p13 = fma(k1, p23, p13)
        p14 = fma(k1, p24, p14)
        p15 = fma(k1, p25, p15)
        p16 = fma(k1, p26, p16)
        p33 = fma(k3, p23, p33)
        p34 = fma(k3, p24, p34)
        p35 = fma(k3, p25, p35)
        p36 = fma(k3, p26, p36)
        p44 = fma(k4, p24, p44)
        p45 = fma(k4, p25, p45)
        p46 = fma(k4, p26, p46)
        p55 = fma(k5, p25, p55)
        p56 = fma(k5, p26, p56)
        p66 = fma(k6, p26, p66)
        kept = measurement_noise[2] * inverse
        p02 = p02 * kept
        p12 = p12 * kept
        p22 = p22 * kept
        p23 = p23 * kept
        p24 = p24 * kept
        p25 = p25 * kept
        p26 = p26 * kept
    out[3] = z_position - x3
    out[4] = z_p1 - x1
    out[5] = z_p2 - x2
    x[0] = x0
    x[1] = x1
    x[2] = x2
    x[3] = x3
    x[4] = x4
    x[5] = x5
    x[6] = x6
    P[0, 0] = p00
    P[0, 1] = P[1, 0] = p01
    P[0, 2] = P[2, 0] = p02
    P[0, 3] = P[3, 0] = p03
    P[0, 4] = P[4, 0] = p04
    P[0, 5] = P[5, 0] = p05
    P[0, 6] = P[6, 0] = p06
    P[1, 1] = p11
    P[1, 2] = P[2, 1] = p12
    P[1, 3] = P[3, 1] = p13
    P[1, 4] = P[4, 1] = p14
    P[1, 5] = P[5, 1] = p15
    P[1, 6] = P[6, 1] = p16
    P[2, 2] = p22
    P[2, 3] = P[3, 2] = p23
    P[2, 4] = P[4, 2] = p24
    P[2, 5] = P[5, 2] = p25
    P[2, 6] = P[6, 2] = p26
    P[3, 3] = p33
    P[3, 4] = P[4, 3] = p34
    P[3, 5] = P[5, 3] = p35
    P[3, 6] = P[6, 3] = p36
    P[4, 4] = p44
    P[4, 5] = P[5, 4] = p45
    P[4, 6] = P[6, 4] = p46
    P[5, 5] = p55
    P[5, 6] = P[6, 5] = p56
    P[6, 6] = p66
