"""Where one curve explains nearly all, only effects that may be it are tried to their end."""

from types import SimpleNamespace
from typing import Any

import pytest

from estimator.gap.verdict.one_curve import OneCurve
from tests.estimator.gap.verdict.test_choosing import FLOOR, READINGS, fit


def seen(of: str) -> Any:
    """Return a discovery of a curve of a force that has no rivals."""
    return SimpleNamespace(explanation=SimpleNamespace(where=("force", of, "")), rivals=())


class Discovers:
    """Stands for `Discovering`: it finds curves that leave so many variances a reading."""

    nuisances = ()

    def __init__(self, left: float, *of: str) -> None:
        self._left, self._of = left, of
        own = {"drag": ("force", "velocity"), "spring": ("force", "position")}
        effects = {k: SimpleNamespace(name=k, own=(where,)) for k, where in own.items()}
        self.plant = SimpleNamespace(effects=effects)
        self.asked = 0

    def run(self, fitted: Any, variables: Any, floor: float, most: int) -> Any:
        self.asked = most
        return SimpleNamespace(
            fitted=fit(self._left), discoveries=[seen(name) for name in self._of]
        )


def found(left: float) -> Any:
    """Return a finding of one effect that leaves so many of ten variances a reading."""
    return SimpleNamespace(refitted=fit(10.0), fitted=fit(left), samples=READINGS)


@pytest.mark.parametrize("named", [5.0, 9.0])
def test_only_effects_whose_own_curve_it_is_are_tried_if_a_curve_explains_nearly_all(
    named: float,
) -> None:
    curve = OneCurve(Discovers(0.1, "velocity"))  # type: ignore[arg-type]
    assert curve.narrowed(found(named), FLOOR) == {"drag"}
    assert curve.is_enough


def test_no_effect_is_tried_if_none_has_such_a_curve() -> None:
    curve = OneCurve(Discovers(0.1, "time"))  # type: ignore[arg-type]
    assert curve.narrowed(found(5.0), FLOOR) == set()


def test_all_effects_are_tried_if_the_curve_leaves_more_than_a_fiftieth() -> None:
    curve = OneCurve(Discovers(0.5, "velocity"))  # type: ignore[arg-type]
    assert curve.narrowed(found(5.0), FLOOR) is None
    assert not curve.is_enough


def test_no_curve_is_looked_for_where_the_effect_leaves_little() -> None:
    discovers = Discovers(0.0, "velocity")
    assert OneCurve(discovers).narrowed(found(0.6), FLOOR) is None  # type: ignore[arg-type]
    assert discovers.asked == 0


def test_nothing_discovered_means_that_all_effects_are_tried() -> None:
    curve = OneCurve(Discovers(10.0))  # type: ignore[arg-type]
    assert curve.narrowed(found(5.0), FLOOR) is None
    assert curve.first is None
