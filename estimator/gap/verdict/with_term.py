"""This module adds an unknown disturbance in symbols to the model, and refits the model with it.

The terms were found on the linearised course, to first order. Here they become parameters of the
plant, so that its filter and its simulation have them, and they are fitted together with the
nuisances.
"""

from typing import Final

from estimator.gap.plant import Effect, Plant
from estimator.gap.prediction import AddedDisturbance, Estimate, Values, effect_variables, freed
from estimator.gap.search import TIME, Found, Refits

from .unknown import Unknown

EFFECT: Final = "unknown_term"
_NORMAL_95: Final = 1.96
_UNITS: Final = {"phase": "rad"}


def with_term(
    refits: Refits, found: Found, unknown: Unknown
) -> tuple[AddedDisturbance | None, list[str]]:
    """Return the disturbance as a part of the refitted model, and remarks on it in words.

    The disturbance is None if the model cannot represent any of its terms, or predicts the records
    no better with it. Terms that it cannot represent are left out, with a remark.

    Args:
        refits: refits of the records.
        found: the finding with the nuisances refitted, and with no effects.
        unknown: the disturbance, to first order.
    """
    plant = refits.plant
    if plant.hold_terms is None or plant.held_terms is None:
        return None, ["the model of this plant cannot hold terms in symbols: none was added"]
    held = plant.hold_terms(
        unknown.place.name, unknown.terms, unknown.coefficients, found.refitted.values
    )
    said = [
        f"the term {unknown.terms_text(plant)[index]} cannot be added to the model: {why}"
        for index, why in held.refused
    ]
    if not held.values:
        return None, said
    effect = Effect(EFFECT, unknown.text(plant), unknown.place.name, held.knobs)
    variables = freed(refits.nuisances, effect)
    before = found.refitted
    values = {name: float(held.values[name]) for name in before.values}
    fitted, filtered = refits.settled(values, variables)
    if not fitted.cost < before.cost:
        return None, [*said, "refitted in the model it predicts no better: it was not added"]
    columns = filtered.columns(fitted.values, variables)
    names = [column.name for column in columns]
    linear = filtered.linearise(fitted.values, columns)
    errors = linear.errors(names, linear.solve(names)[0])
    own = effect_variables(effect)
    estimates = tuple(
        _estimate(plant, fitted.values, variable.key, variable.parameter, float(error))
        for variable, error in zip(variables, errors, strict=True)
        if variable in own
    )
    excess = [cost / found.samples - found.floor for cost in (before.cost, fitted.cost)]
    explained = 1.0 - excess[1] / excess[0] if excess[0] > 0.0 else float("nan")
    text = terms_in_words(plant, fitted.values)
    return AddedDisturbance(
        unknown.place.name, text, estimates, dict(fitted.values), explained
    ), said


def terms_in_words(plant: Plant, values: Values) -> str:
    """Return the terms that parameter values represent, in symbols with units.

    The plant must be able to hold terms, and the values must represent at least one.
    """
    assert plant.held_terms is not None
    place, terms = plant.held_terms(values)
    regions = {**plant.regions, TIME.name: TIME}
    unit = next(equation.unit for equation in plant.equations if equation.name == place)
    return " ".join(term.text(own, unit, regions) for term, own in terms)


def _estimate(plant: Plant, values: Values, key: str, parameter: str, error: float) -> Estimate:
    value, reach = values[parameter], _NORMAL_95 * error
    assert plant.held_terms is not None
    place, terms = plant.held_terms(values)
    regions = {**plant.regions, TIME.name: TIME}
    term, _ = terms[int(key.split("_")[1]) - 1]
    part = key.split("_")[2]
    if part == "size":
        unit = next(equation.unit for equation in plant.equations if equation.name == place)
        unit = term.unit(unit, regions)
    else:
        unit = _UNITS.get(part) or regions[term.region].unit
    return Estimate(key, parameter, value, value - reach, value + reach, unit, 0.0)
