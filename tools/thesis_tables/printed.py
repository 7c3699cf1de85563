"""The figures that the thesis prints in its tables and text, in SI except for flows in L/min."""

from dataclasses import dataclass
from typing import Final

from .measures import Change, Coefficient

UNTOLD: Final = Change(None, None)


@dataclass(frozen=True)
class Printed:
    """The figures that the thesis prints of one test.

    Attributes:
        coefficient: mean and standard deviation in m^3/(s Pa^0.5), although the thesis prints the
            unit m^3/(s Pa); None if it is not printed.
        flow: mean leak flow before and after the leak, L/min; None where it is not printed.
        averages: moving averages of the absolute pressure errors of chambers 1 and 2, each before
            and after the leak, Pa; None where they are not printed.
    """

    coefficient: Coefficient | None = None
    flow: Change = UNTOLD
    averages: tuple[Change, Change] = (UNTOLD, UNTOLD)


PrintedTable = dict[str, tuple[Printed, ...]]
"""Printed figures by kind of leak, or under "healthy"; a kind has its levels, smallest first."""


def _unloaded(
    mean: float, deviation: float, mae: tuple[float, float] | None = None, flow: float | None = None
) -> Printed:
    """Return a column of tables 5.1 to 5.3.

    Args:
        mean: mean of the coefficient, in 1e-9 m^3/(s Pa^0.5).
        deviation: standard deviation of the coefficient, in 1e-10 m^3/(s Pa^0.5).
        mae: moving averages of chambers 1 and 2 after the leak, in 1e6 Pa.
        flow: flow after the leak, L/min.
    """
    averages = (UNTOLD, UNTOLD)
    if mae is not None:
        averages = (Change(None, 1e6 * mae[0]), Change(None, 1e6 * mae[1]))
    return Printed(Coefficient(1e-9 * mean, 1e-10 * deviation), Change(None, flow), averages)


def _loaded(
    flow: tuple[float, float],
    mae_1: tuple[float, float],
    mae_2: tuple[float, float],
    coefficient: Coefficient | None = None,
) -> Printed:
    """Return a pair of columns of tables 7.1 to 7.3, which are (before, after) the leak.

    Args:
        flow: leak flow, L/min.
        mae_1: moving averages of chamber 1, in 1e5 Pa.
        mae_2: moving averages of chamber 2, in 1e5 Pa.
        coefficient: coefficient of the leak, if the text has it.
    """
    averages = tuple(Change(1e5 * before, 1e5 * after) for before, after in (mae_1, mae_2))
    return Printed(coefficient, Change(*flow), (averages[0], averages[1]))


_HEALTHY_LEVEL: Final = Change(1e5, None)

TABLE_5_1: Final[PrintedTable] = {
    # The healthy level and the flows of chamber 1 are from chapter 8, open loop: "from 10^5 Pa to
    # 1.5x10^5 Pa and higher".
    "healthy": (Printed(averages=(_HEALTHY_LEVEL, _HEALTHY_LEVEL)),),
    "external_leakage_1": (
        _unloaded(3.87, 8.03, (0.19, 0.08), 0.55),
        _unloaded(7.67, 14.04, (0.34, 0.11), 1.01),
    ),
    "external_leakage_2": (
        _unloaded(4.04, 7.03, (0.10, 0.21)),
        _unloaded(9.50, 16.26, (0.15, 0.40)),
    ),
    "internal_leakage": (
        _unloaded(11.10, 26.00, (0.16, 0.20)),
        _unloaded(14.43, 30.90, (0.22, 0.26)),
    ),
}

TABLE_5_2: Final[PrintedTable] = {
    "external_leakage_1": (
        _unloaded(4.18, 12.70, (0.24, 0.19)),
        _unloaded(7.31, 15.43, (0.38, 0.25)),
    ),
    "external_leakage_2": (
        _unloaded(6.06, 15.34, (0.17, 0.32)),
        _unloaded(10.07, 20.60, (0.20, 0.49)),
    ),
    "internal_leakage": (
        _unloaded(10.12, 23.60, (0.20, 0.25)),
        _unloaded(12.28, 24.10, (0.29, 0.31)),
    ),
}

TABLE_5_3: Final[PrintedTable] = {
    "external_leakage_1": (_unloaded(6.83, 10.19), _unloaded(12.69, 20.20)),
    "external_leakage_2": (_unloaded(8.45, 14.58), _unloaded(12.52, 20.40)),
    "internal_leakage": (_unloaded(13.42, 18.70), _unloaded(15.54, 21.50)),
}

SECTION_7_1: Final[PrintedTable] = {
    # In figures 7.13 to 7.15 the coefficients were set; the averages are drawn, but not printed.
    "external_leakage_1": tuple(Printed(Coefficient(k, 0.0)) for k in (2e-12, 4e-12, 6e-12)),
    "external_leakage_2": tuple(Printed(Coefficient(k, 0.0)) for k in (2e-12, 4e-12, 6e-12)),
    "internal_leakage": tuple(Printed(Coefficient(k, 0.0)) for k in (4e-12, 6e-12, 8e-12)),
}

SECTION_7_2: Final[PrintedTable] = {
    # These are tables 7.1 to 7.3; the coefficients of the low levels are from the text.
    "external_leakage_1": (
        _loaded((0.09, 0.32), (0.31, 0.65), (0.32, 0.25), Coefficient(7.65e-9, 22.08e-10)),
        _loaded((0.09, 0.46), (0.30, 1.08), (0.34, 0.35)),
        _loaded((0.09, 0.56), (0.31, 1.33), (0.36, 0.45)),
    ),
    "external_leakage_2": (
        _loaded((0.09, 0.35), (0.30, 0.26), (0.31, 0.46), Coefficient(10.68e-9, 31.30e-13)),
        _loaded((0.09, 0.53), (0.33, 0.26), (0.28, 0.93)),
        _loaded((0.09, 0.68), (0.34, 0.34), (0.30, 1.31)),
    ),
    "internal_leakage": (
        _loaded((0.02, 0.26), (0.32, 0.79), (0.26, 0.58), Coefficient(8.65e-9, 33.22e-10)),
        _loaded((0.02, 0.38), (0.32, 1.08), (0.25, 0.75)),
        _loaded((0.02, 0.84), (0.31, 2.23), (0.27, 1.34)),
    ),
}
