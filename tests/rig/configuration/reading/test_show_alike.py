"""Values that are compared on a line are shown in one unit, and apart where they differ."""

from math import inf, nan

import pytest

from rig.configuration import show, show_alike


@pytest.mark.parametrize(
    ("values", "unit", "texts"),
    [
        ((0.02675, 0.6), "", ["2.675 %", "60 %"]),
        ((5.1e-3, 5e-3), "m", ["5.1 mm", "5 mm"]),
        ((0.35000004, 0.35), "m", ["0.35000004 m", "0.35 m"]),
        ((0.35, 0.35), "m", ["0.35 m", "0.35 m"]),
        ((13.8e6, 5.0), "Pa", ["13.8 MPa", "5 Pa"]),
        ((inf, -inf, nan, 2e-3), "s", ["without bound", "-inf", "not known", "2 ms"]),
        ((0.0, 0.0), "m", ["0 m", "0 m"]),
    ],
)
def test_values_are_shown_in_one_unit(
    values: tuple[float, ...], unit: str, texts: list[str]
) -> None:
    assert show_alike(values, unit) == texts


def test_a_millionth_of_a_second_has_a_unit_of_its_own() -> None:
    assert show(1e-6, "s") == "1 us"
