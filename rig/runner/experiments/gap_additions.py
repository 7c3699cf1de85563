"""Converts what the gap workflow adds to a model to the terms of a model file, and back."""

from collections.abc import Mapping, Sequence

from estimator.gap import Plant, addition_of, servo_actuator, term_of
from rig.plant import AddedTerm, Model, Parameters


def slots_of(plant: Plant, terms: Sequence[AddedTerm]) -> dict[str, float]:
    """Return the values of all parameters that hold additions, those of the plant's model too.

    Args:
        plant: the rig as the workflow's plant, whose model holds terms already.
        terms: at most `MOST_OTHERS` terms that the rig's equations cannot hold. Those that the
            slots cannot hold either are left out.
    """
    layout = plant.layout
    assert layout is not None
    additions = [addition_of(term) for term in terms]
    kept = [each for each in additions if not layout.why_not(each)]
    return layout.values([*layout.additions(plant.nominal), *kept])


def with_terms(
    values: Mapping[str, float], given: Sequence[AddedTerm] = ()
) -> tuple[Parameters, tuple[AddedTerm, ...]]:
    """Return the rig's parameters with the terms that they hold, and all other terms of a model.

    Args:
        values: values of all parameters of the workflow's plant, by name.
        given: terms of the model as given that the rig's equations cannot hold; those that the
            slots could not hold either stay as they are.
    """
    parameters = Parameters(**{field: values[field] for field in Parameters._fields})
    plant = servo_actuator(Model(parameters=parameters))
    layout = plant.layout
    assert layout is not None
    own = len(layout.additions(plant.nominal))
    in_slots = (term_of(each) for each in layout.additions(values)[own:])
    nowhere = (term for term in given if layout.why_not(addition_of(term)))
    return parameters, (*nowhere, *in_slots)
