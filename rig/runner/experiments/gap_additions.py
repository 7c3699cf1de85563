"""Converts what the gap workflow adds to a model between its slots and the terms of a model file."""

from collections.abc import Mapping, Sequence

from estimator.gap import Plant, addition_of, servo_actuator, term_of
from rig.plant import AddedTerm, Model, Parameters


def slots_of(plant: Plant, terms: Sequence[AddedTerm]) -> dict[str, float]:
    """Return the values of all that holds additions, with terms which the rig cannot hold.

    Terms that the slots cannot hold either are left out.
    """
    layout = plant.layout
    assert layout is not None
    additions = [addition_of(term) for term in terms]
    kept = [each for each in additions if not layout.why_not(each)]
    return layout.values([*layout.additions(plant.nominal), *kept])


def with_terms(values: Mapping[str, float]) -> tuple[Parameters, tuple[AddedTerm, ...]]:
    """Return the rig's parameters with the terms that they hold, and the terms of the slots.

    Args:
        values: values of all parameters of the workflow's plant, by name.
    """
    parameters = Parameters(**{field: values[field] for field in Parameters._fields})
    plant = servo_actuator(Model(parameters=parameters))
    layout = plant.layout
    assert layout is not None
    own = len(layout.additions(plant.nominal))
    return parameters, tuple(term_of(each) for each in layout.additions(values)[own:])
