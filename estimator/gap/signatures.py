"""What effects look like in the innovations once the nuisances have had their share.

From block sums of one linearisation: how alike two effects are (`cosine`), and the smallest size of
each that the motion would have shown (`limits`).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from .fit import Fitter
from .linear import Column, Linear
from .plant import Array, Effect, Plant
from .results import DetectionLimit
from .search import CHANCE, MATERIAL
from .variables import Values, Variable, effect_variables, started

_ENDLESS: Final = 10.0
"""A neutral value so many times above all starts is a limit that no motion reaches."""


def left(linear: Linear, names: Sequence[str], nuisances: Sequence[str]) -> Array:
    """Return the products (names, names) of columns with the nuisances projected out."""
    total = linear.products.sum(0)
    own, base = linear.indices(names), linear.indices(nuisances)
    if not base:
        return np.asarray(total[np.ix_(own, own)])
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total)[base], 1e-300))
    inner = np.linalg.pinv(total[np.ix_(base, base)] * np.outer(scale, scale), rcond=1e-10)
    cross = total[np.ix_(own, base)] * scale
    return np.asarray(total[np.ix_(own, own)] - cross @ inner @ cross.T)


def cosines(
    fitter: Fitter, values: Values, variables: Sequence[Variable], changes: Mapping[str, Values]
) -> Array:
    """Return the cosine of the first of some changes with each (changes,).

    Args:
        fitter: of the records, with gains.
        values: without any of the changes.
        variables: to be projected out.
        changes: values of all parameters with a change, by its name.
    """
    base = fitter.columns(values, variables)
    columns = [Column(name, changed, 1.0) for name, changed in changes.items()]
    linear = fitter.linearise(values, [*base, *columns])
    products = left(linear, list(changes), [column.name for column in base])
    squares = np.maximum(np.diag(products), 1e-300)
    return np.asarray(products[0] / np.sqrt(squares[0] * squares))


def limits(fitter: Fitter, values: Values, variables: Sequence[Variable]) -> list[DetectionLimit]:
    """Return the smallest size of each effect that these motions would show.

    The distance from the value written at which its gain, as the linearisation has it, reaches the
    bar (`search`); infinite for an effect that no size within its bounds would show. Effects whose
    starts depend on the motion are left out: they have no first order.
    """
    plant = fitter.predictor.plant
    base = fitter.columns(values, variables)
    columns = {column.name: column for column in base}
    tried: dict[str, list[tuple[str, Mapping[str, float]]]] = {}
    for effect in plant.effects.values():
        tried[effect.name] = []
        for number, start in enumerate(effect.starts):
            name = f"{effect.name}#{number}"
            columns[name] = Column(name, started(plant, values, effect, start), 1.0)
            tried[effect.name].append((name, start))
        if not tried[effect.name] and effect.propose is None:
            knob = effect_variables(effect)[0]
            column = fitter.columns(values, [knob])[0]
            columns[column.name] = column
            tried[effect.name].append((column.name, {}))
    linear = fitter.linearise(values, list(columns.values()))
    found = []
    for effect in plant.effects.values():
        own = {variable.parameter for variable in effect_variables(effect)}
        kept = [
            column.name
            for column, variable in zip(base, variables, strict=True)
            if variable.parameter not in own
        ]
        if tried[effect.name]:
            found.append(_limit(plant, values, effect, linear, tried[effect.name], kept))
    return found


def _limit(
    plant: Plant, values: Values, effect: Effect, linear: Linear,
    tried: Sequence[tuple[str, Mapping[str, float]]], kept: Sequence[str],
) -> DetectionLimit:  # fmt: skip
    knob = effect.knobs[0]
    unit = next(p.unit for p in plant.parameters if p.name == knob.parameter)
    neutral, present = plant.nominal[knob.parameter], values[knob.parameter]
    ratios, sizes = [], []
    for name, start in tried:
        gain = float(left(linear, [name], kept)[0, 0])
        place = linear.indices([name])[0]
        square = float(linear.products[:, place, place].sum())
        acting = min(1.0, 3.0 * square**2 / max(linear.quartics[place], 1e-300) / linear.samples)
        bar = max(CHANCE, MATERIAL * acting * linear.samples)
        step = abs(effect_variables(effect)[0].reach(values, 1.0))
        size = abs(start[knob.key] - present) if start else step
        ratios.append(np.sqrt(bar / gain) if gain > 0.0 else np.inf)
        sizes.append(size)
    starts = [start[knob.key] for _, start in tried if start]
    if starts and neutral > _ENDLESS * max(starts):
        shown = [value for value, ratio in zip(starts, ratios, strict=True) if ratio <= 1.0]
        return DetectionLimit(effect.name, knob.key, max(shown, default=0.0), unit)
    # The start nearest to the size itself: there the effect is as the linearisation has it.
    near = int(np.argmin(np.abs(np.log(np.maximum(ratios, 1e-12))))) if starts else 0
    if len(effect.knobs) > 1 and starts:
        near = int(np.argmin(np.array(ratios) * sizes))
    size = float(ratios[near] * sizes[near])
    tolerance = next(
        (n.tolerance * abs(n.nominal) for n in plant.nuisances if n.effect == effect.name), 0.0
    )
    size = max(size, tolerance)
    reach = max(abs(knob.upper - present), abs(knob.lower - present))
    return DetectionLimit(effect.name, knob.key, size if size <= reach else np.inf, unit)
