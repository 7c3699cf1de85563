"""This module computes signatures: what effects change in the innovations, nuisances projected out.

The nuisances are projected out because their refit explains a part of any change. From the block
sums of one linearisation follow how alike two effects are (`cosines`), and the smallest size of
each that the motion would have shown (`limits`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Effect, Knob, Plant
from estimator.gap.prediction import (
    Changes,
    Column,
    DetectionLimit,
    Filtered,
    Linear,
    Values,
    Variable,
    assemble,
    effect_variables,
    started,
)

from .findings import CHANCE, FEW_BLOCKS, MATERIAL, Found
from .search import Search

ABSORBED: Final = 0.1
"""An effect cannot be distinguished from the nuisances if their refit leaves less than this part of
its squared change of the innovations."""
_REFITTED: Final = 0.01
"""Smallest change of a nuisance by its refit that is worth a remark, as a part of its value."""
_TRIES: Final = 4
"""Greatest number of times that a size is tried and corrected."""
_FAR: Final = 30.0
"""Greatest factor from one size that is tried to the next."""
_FEW: Final = 2.0
"""Least factor to the next size if the one tried shows in a few blocks only."""
_NEAR: Final = 0.2
"""The search for a size ends when the next size is nearer than this to the one tried, in the
natural logarithm. A size may also exceed the plausible range by this part of it."""
ENDLESS: Final = 10.0
"""A parameter is a limit that no motion reaches if its neutral value is more than this many times
the greatest plausible value."""
_LIMITS: Final = 7
"""Number of values of such a limit that are tried at once, in lanes."""


def left(linear: Linear, names: Sequence[str], nuisances: Sequence[str]) -> Array:
    """Return the products of columns with each other (names, names), nuisances projected out.

    `nuisances` are the names of those columns of `linear` that are projected out. The products are
    summed over all blocks.
    """
    total = linear.products.sum(0)
    own, base = linear.indices(names), linear.indices(nuisances)
    if not base:
        return np.asarray(total[np.ix_(own, own)])
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total)[base], 1e-300))
    inner = np.linalg.pinv(total[np.ix_(base, base)] * np.outer(scale, scale), rcond=1e-10)
    cross = total[np.ix_(own, base)] * scale
    return np.asarray(total[np.ix_(own, own)] - cross @ inner @ cross.T)


def cosines(
    filtered: Filtered, values: Values, variables: Sequence[Variable], changes: Mapping[str, Values]
) -> Array:
    """Return the cosines (changes,) of the first change's signature with that of each change.

    All are NaN if the model breaks down without the changes, as beyond a stop that it does not
    have.

    Args:
        filtered: the records, with any filter gains.
        values: values of all parameters without any of the changes.
        variables: variables that are projected out.
        changes: by the name of each change, values of all parameters with it.
    """
    base = filtered.columns(values, variables)
    columns = [Column(name, changed, 1.0) for name, changed in changes.items()]
    linear = filtered.linearise(values, [*base, *columns])
    if not np.isfinite(linear.products).all():
        return np.full(len(changes), np.nan)
    products = left(linear, list(changes), [column.name for column in base])
    squares = np.maximum(np.diag(products), 1e-300)
    return np.asarray(products[0] / np.sqrt(squares[0] * squares))


def absorbed(search: Search, found: Found) -> list[str]:
    """Return remarks, in words, on effects that the refit of a nuisance may stand for.

    Only effects are looked at that are the same on principle as the effect of the nuisance
    (`Plant.not_told_apart`), where neither was named and the refit moved the nuisance by 1 % or
    more. A remark is made if what was fitted would make up for all but a tenth of what the effect
    changes in these recordings, and if the effect can plausibly be of the size of the refit.
    """
    plant, filtered, values = search.plant, found.filtered, found.fitted.values
    named = {each.effect for each in found.named}
    base = filtered.columns(values, found.variables)
    said = []
    for nuisance in plant.nuisances:
        shift = values[nuisance.parameter] / plant.nominal[nuisance.parameter] - 1.0
        if nuisance.effect is None or nuisance.effect in named or abs(shift) < _REFITTED:
            continue
        for pair, why in plant.not_told_apart.items():
            others = pair - {nuisance.effect}
            if len(others) != 1 or others & named or not others <= plant.effects.keys():
                continue
            (other,) = others
            column = filtered.columns(values, effect_variables(plant.effects[other])[:1])[0]
            linear = filtered.linearise(values, [*base, column])
            products = left(linear, [column.name], [each.name for each in base])
            whole = float(linear.products[:, -1, -1].sum())
            # The size of the effect that equals the refit must be possible: air makes no oil
            # stiffer.
            own = linear.indices([nuisance.parameter + ".", column.name])
            both = linear.products.sum(0)[np.ix_(own, own)]
            moved = values[nuisance.parameter] - plant.nominal[nuisance.parameter]
            size = moved * float(both[0, 1]) / max(float(both[1, 1]), 1e-300)
            possible = column.lower <= size <= column.upper
            if possible and float(products[0, 0]) < ABSORBED * whole:
                said.append(
                    f"the refit of {nuisance.parameter} by {shift:+.1%} may be {other} as well, "
                    f"of which these motions show no more: {why}"
                )
    return said


def limits(
    filtered: Filtered, values: Values, variables: Sequence[Variable]
) -> list[DetectionLimit]:
    """Return the smallest size of each effect that these motions would show.

    A size is the distance of the effect's parameter from its value in `values`. It shows if its
    gain reaches both `CHANCE` and what matters where the effect acts (`MATERIAL`), in more than two
    blocks. The gain is what it adds to the cost after `variables` have been refitted. The size is
    infinite if no size within the bounds would show.

    If the effect is a nuisance within a tolerance, only what lies beyond the tolerance shows. For a
    limit that no motion reaches at its neutral value, the size is the largest value that shows; 0
    if none does; the limit is left out if `values` hold one that acts. Other effects that have only
    starts that depend on the motion are left out, because they cannot be linearised. Effects with
    several knobs are judged by their first knob, from the linearisation alone.
    """
    plant = filtered.predictor.plant
    base = filtered.columns(values, variables)
    columns = {column.name: column for column in base}
    tried: dict[str, list[tuple[str, Mapping[str, float]]]] = {}
    endless = [effect for effect in plant.effects.values() if _is_endless(plant, effect)]
    for effect in plant.effects.values():
        tried[effect.name] = []
        if effect in endless:
            continue
        for number, start in enumerate(effect.starts):
            name = f"{effect.name}#{number}"
            columns[name] = Column(name, started(plant, values, effect, start), 1.0)
            tried[effect.name].append((name, start))
        if not tried[effect.name] and effect.propose is None:
            knob = effect_variables(effect)[0]
            column = filtered.columns(values, [knob])[0]
            columns[column.name] = column
            tried[effect.name].append((column.name, {}))
    linear = filtered.linearise(values, list(columns.values()))
    found: list[DetectionLimit] = []
    guesses: dict[int, _Guess] = {}
    for effect in plant.effects.values():
        own = {variable.parameter for variable in effect_variables(effect)}
        kept = [
            column.name
            for column, variable in zip(base, variables, strict=True)
            if variable.parameter not in own
        ]
        if not tried[effect.name]:
            continue
        limit = _limit(plant, values, effect, linear, tried[effect.name], kept)
        if len(effect.knobs) == 1 and 0.0 < limit.size < np.inf:
            sign = _direction(values, effect, tried[effect.name])
            nuisances = tuple(columns[name] for name in kept)
            variable = effect_variables(effect)[0]
            guesses[len(found)] = _Guess(variable, nuisances, sign * limit.size)
        found.append(limit)
    _check(filtered, values, list(guesses.values()))
    for place, guess in guesses.items():
        found[place] = replace(found[place], size=guess.size(values))
    found = [_beyond_tolerance(plant, values, limit) for limit in found]
    for effect in endless:
        limited = effect.knobs[0]
        # A limit that was found has no size from which it would have shown.
        if _far_above(values[limited.parameter], limited):
            size = _largest_shown(filtered, values, effect_variables(effect)[0], base)
            found.append(DetectionLimit(effect.name, limited.key, size, _unit(plant, limited)))
    return found


def _far_above(value: float, knob: Knob) -> bool:
    return knob.lower > 0.0 and value > ENDLESS * knob.upper


def _is_endless(plant: Plant, effect: Effect) -> bool:
    """Return whether an effect is a limit whose neutral value no motion reaches."""
    knob = effect.knobs[0]
    return len(effect.knobs) == 1 and _far_above(plant.nominal[knob.parameter], knob)


def _unit(plant: Plant, knob: Knob) -> str:
    return next(p.unit for p in plant.parameters if p.name == knob.parameter)


def _largest_shown(
    filtered: Filtered, values: Values, variable: Variable, nuisances: Sequence[Column]
) -> float:
    """Return the largest value of a limit that would show, of those tried; 0 if none does.

    Values between the bounds of `variable` are tried, then some between the largest that shows and
    the next.
    """

    def largest(tried: Array) -> float:
        columns = [Column("change", variable.put(values, float(value)), 1.0) for value in tried]
        shown = [0.0]
        for value, moved in zip(tried, filtered.changes(values, columns), strict=True):
            gain, bar, blocks = _shown(filtered, values, moved, nuisances)
            if gain >= bar and blocks > FEW_BLOCKS:
                shown.append(float(value))
        return max(shown)

    tried = np.geomspace(variable.lower, variable.upper, _LIMITS)
    best = largest(tried)
    above = tried[tried > best]
    if best == 0.0 or not len(above):
        return best
    return max(best, largest(np.geomspace(best, above[0], _LIMITS + 2)[1:-1]))


def _beyond_tolerance(plant: Plant, values: Values, limit: DetectionLimit) -> DetectionLimit:
    """Return a detection limit that allows for the tolerance, if its effect is also a nuisance.

    The limit of any other effect is returned as it is. A refit moves a nuisance anywhere within its
    tolerance, which lies about the nominal value and not about the value written. So only what lies
    beyond the farther end of the tolerance can show. A size beyond the plausible range becomes
    infinite.
    """
    knob = plant.effects[limit.effect].knobs[0]
    refitted = [n for n in plant.nuisances if n.effect == limit.effect]
    if not refitted:
        return limit
    present = values[knob.parameter]
    nuisance = refitted[0]
    width = nuisance.tolerance * abs(nuisance.nominal)
    size = limit.size + width + abs(present - nuisance.nominal)
    reach = max(knob.upper - present, present - knob.lower)
    return replace(limit, size=size if size <= reach * (1.0 + _NEAR) else float("inf"))


def _direction(
    values: Values, effect: Effect, tried: Sequence[tuple[str, Mapping[str, float]]]
) -> float:
    """Return the sign, 1 or -1, of the change to an effect's first start or, if none, of its probe.

    It is 0 if the start is the present value.
    """
    knob, (_, start) = effect.knobs[0], tried[0]
    if knob.key in start:
        return float(np.sign(start[knob.key] - values[knob.parameter]))
    return float(np.sign(effect_variables(effect)[0].column(values).size))


@dataclass
class _Guess:
    """A guess at the smallest change of an effect that would show.

    Attributes:
        variable: variable of the effect's parameter.
        nuisances: columns that may explain a part of the change.
        change: change from the value written, SI.
        settled: whether trying it again would change it little.
    """

    variable: Variable
    nuisances: tuple[Column, ...]
    change: float
    settled: bool = False

    def tried(self, values: Values) -> float:
        """Return the value of the parameter after the change, within its bounds."""
        return self.variable.within(values[self.variable.parameter] + self.change)

    def size(self, values: Values) -> float:
        """Return the size from which the effect shows; infinite if no plausible size does."""
        present = values[self.variable.parameter]
        upwards = self.change > 0.0
        reach = self.variable.upper - present if upwards else present - self.variable.lower
        return abs(self.change) if abs(self.change) <= reach * (1.0 + _NEAR) else float("inf")


def _check(filtered: Filtered, values: Values, guesses: Sequence[_Guess]) -> None:
    """Try guesses at what would show, and correct them in place.

    The first guesses come from a linearisation. If its probe is much larger than the size sought,
    it makes a ram stick or slip in a few samples, which says nothing of a small change. So the
    effects are run at the guessed size itself, and again if it was far off.
    """
    for _ in range(_TRIES):
        for guess in guesses:
            if guess.tried(values) == values[guess.variable.parameter]:
                guess.change, guess.settled = float("inf"), True
        left = [guess for guess in guesses if not guess.settled]
        columns = [
            Column("change", guess.variable.put(values, guess.tried(values)), 1.0) for guess in left
        ]
        # All changes are asked for at once, so that they can run side by side.
        for guess, moved in zip(left, filtered.changes(values, columns), strict=True):
            gain, bar, blocks = _shown(filtered, values, moved, guess.nuisances)
            factor = np.sqrt(bar / gain) if gain > 0.0 else _FAR
            if blocks <= FEW_BLOCKS:
                factor = max(factor, _FEW)
            present = values[guess.variable.parameter]
            guess.change = float((guess.tried(values) - present) * min(factor, _FAR))
            guess.settled = bool(abs(np.log(factor)) < _NEAR)


def _shown(
    filtered: Filtered, values: Values, moved: Changes, nuisances: Sequence[Column]
) -> tuple[float, float, float]:
    """Return what a change adds to the cost, the bar for that, and in how many blocks it does so.

    As in a fit, large innovations count in proportion, and the nuisances are refitted first.
    `moved` holds the change of each record's innovations.
    """
    followed = filtered.changes(values, nuisances)
    linear = assemble(nuisances, moved, followed, filtered.used, filtered.blocks, filtered.pool)
    steps, _ = linear.solve([column.name for column in nuisances])
    gains = linear.squares + 2.0 * linear.slopes @ steps + (linear.products @ steps) @ steps
    gains = np.maximum(gains, 0.0)
    squares = np.concatenate(
        [
            np.square(part[block]).ravel()
            for part, blocks in zip(moved, filtered.blocks, strict=True)
            for block in blocks
        ]
    )
    acting = min(1.0, acting_number(squares) / max(linear.samples, 1))
    bar = max(CHANCE, MATERIAL * acting * linear.samples)
    return float(gains.sum()), bar, float(gains.sum() ** 2 / max(np.square(gains).sum(), 1e-300))


def acting_number(squares: Array) -> float:
    """Return how many readings a change moves, given the square (n,) of its change of each reading.

    If the changes are normally distributed this is n, because their fourth moment is three times
    the square of the second.
    """
    return float(3.0 * squares.sum() ** 2 / max(np.square(squares).sum(), 1e-300))


def _limit(
    plant: Plant, values: Values, effect: Effect, linear: Linear,
    tried: Sequence[tuple[str, Mapping[str, float]]], kept: Sequence[str],
) -> DetectionLimit:  # fmt: skip
    knob = effect.knobs[0]
    present = values[knob.parameter]
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
    # The start nearest to the size itself is taken, because the linearisation is best there.
    near = int(np.argmin(np.abs(np.log(np.maximum(ratios, 1e-12))))) if starts else 0
    if len(effect.knobs) > 1 and starts:
        near = int(np.argmin(np.array(ratios) * sizes))
    size = float(ratios[near] * sizes[near])
    reach = max(abs(knob.upper - present), abs(knob.lower - present))
    return DetectionLimit(
        effect.name, knob.key, size if size <= reach else np.inf, _unit(plant, knob)
    )
