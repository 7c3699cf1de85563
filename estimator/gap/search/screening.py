"""This module estimates, from one linearisation, what each effect of the catalogue would gain."""

from collections.abc import Collection, Mapping, Sequence
from typing import Final

from estimator.gap.plant import Effect, Plant, Trace
from estimator.gap.prediction import Column, Filtered, Values, Variable, effect_variables, started

from .findings import Screened

_FAR: Final = 10.0**0.5
"""Ratio of one far value of a logarithmic parameter to the next one that is tried."""
_POWERS: Final = 4
"""Number of far values that are tried on either side."""


class Screening:
    """Screens effects of a plant's catalogue by what they would gain in records.

    Args:
        plant: plant whose effects are screened.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant

    def screen(
        self,
        filtered: Filtered,
        values: Values,
        variables: tuple[Variable, ...],
        effects: Collection[str] | None = None,
    ) -> list[Screened]:
        """Return all candidates that would gain something, that with most gain first.

        The gain of a candidate is by how much it would lower the cost: by the linearisation, or at
        its start itself if that is more. An effect has one candidate, with its best start. Effects
        that are fitted already, with all their knobs among `variables`, are left out.

        Args:
            filtered: the records, with any filter gains.
            values: values of all parameters, about which the innovations are linearised.
            variables: variables that are fitted together with each candidate.
            effects: names of the effects to be screened; None for all.
        """
        columns = filtered.columns(values, variables)
        base = [column.name for column in columns]
        starts: dict[str, tuple[str, Mapping[str, float], list[str]]] = {}
        fitted = {variable.parameter for variable in variables if variable.key}
        for effect in self.plant.effects.values():
            if all(knob.parameter in fitted for knob in effect.knobs):
                continue
            if effects is not None and effect.name not in effects:
                continue
            has_slope = not effect.starts and effect.propose is None
            given = _far(values, effect) if has_slope else starts_of(filtered, values, effect)
            for number, start in enumerate(given):
                column = Column(
                    f"{effect.name}#{number}", started(self.plant, values, effect, start), 1.0, 0.0
                )
                columns.append(column)
                starts[column.name] = (effect.name, start, [column.name])
            if has_slope:
                added = filtered.columns(values, effect_variables(effect))
                columns += added
                starts[added[0].name] = (effect.name, {}, [column.name for column in added])
        linear = filtered.linearise(values, columns)
        without = linear.solve(base)[1]
        reached = self._reached(filtered, values, [c for c in columns if "#" in c.name])
        best: dict[str, Screened] = {}
        for name, (added_effect, start, names) in starts.items():
            parameters = {v.parameter for v in effect_variables(self.plant.effects[added_effect])}
            kept = [
                c for c, v in zip(base, variables, strict=True) if v.parameter not in parameters
            ]
            gain = linear.solve([*kept, *names])[1] - without
            gain = max(gain, reached.get(name, 0.0) - without)
            index = linear.indices([name])[0]
            square = float(linear.products[:, index, index].sum())
            acting = min(
                1.0, 3.0 * square**2 / max(linear.quartics[index], 1e-300) / linear.samples
            )
            if gain > 0.0 and (added_effect not in best or gain > best[added_effect].gain):
                best[added_effect] = Screened(added_effect, start, gain, acting)
        return sorted(best.values(), key=lambda candidate: -candidate.gain)

    def _reached(
        self, filtered: Filtered, values: Values, columns: Sequence[Column]
    ) -> dict[str, float]:
        """Return by how much the cost falls at starts themselves, by the names of their columns.

        Each column is the change to one start; nothing is fitted. The linearisation cannot show
        this, because large effects are far from linear.
        """
        before = filtered.costs(values).sum()
        changes = filtered.changes(values, columns)
        costs = filtered.pool.map(lambda change: filtered.changed_costs(values, change), changes)
        return {
            column.name: float(before - left.sum())
            for column, left in zip(columns, costs, strict=True)
        }


def _far(values: Values, effect: Effect) -> tuple[Mapping[str, float], ...]:
    """Return far values of an effect's only knob that a fit may start from, if it is logarithmic.

    They are `_FAR` and its powers times or below the present value, within the plausible range.
    Over such a range an effect is far from linear: of seals fifteen times as soft the linearisation
    about stiff ones showed a twentieth of what they gain.
    """
    if len(effect.knobs) != 1 or not effect.knobs[0].logarithmic:
        return ()
    (knob,) = effect.knobs
    far = [values[knob.parameter] * _FAR**power for power in range(-_POWERS, _POWERS + 1) if power]
    return tuple({knob.key: value} for value in far if knob.lower < value < knob.upper)


def starts_of(
    filtered: Filtered, values: Values, effect: Effect
) -> tuple[Mapping[str, float], ...]:
    """Return where fits of an effect start: its stated starts, then those from the records.

    Args:
        filtered: the records, with any filter gains.
        values: values of all parameters, with which the records are predicted.
        effect: the effect.
    """
    if effect.propose is None:
        return effect.starts
    traces = [
        Trace(record.inputs, states, innovations, record.readings)
        for record, (innovations, states) in zip(
            filtered.records, filtered.innovations(values), strict=True
        )
    ]
    return (*effect.starts, *effect.propose(traces, values))
