"""The key `discovered` in the model file of a plant that a user describes.

It has the same form as in a rig's model file (module `discovered`), with the places and the
quantities of the plant. The plant's slots hold all of these terms.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from estimator.gap import SLOTS, Addition, Plant, PlantDescription, as_addition, as_term
from rig.configuration.reading import Located

from .discovered import KEY, Vocabulary, lines_of, read_term

_DIRECTION: Final = "direction"
_EXAMPLE: Final = "write `- {to: EQUATION, of: REGION, form: x, size: ...}`"


def vocabulary(thing: PlantDescription | Plant) -> Vocabulary:
    """Return the places that additions to a plant may name, and the quantities, with their units.

    The places are its equations, the readings of its outputs and the parameters that may vary; the
    quantities are its regions and the time.
    """
    if isinstance(thing, Plant):
        regions = {each.name: each.unit for each in thing.regions.values()}
        varying = {each.name: each.unit for each in thing.varying}
    else:
        units = {each.name: each.unit for each in thing.parameters}
        regions = {each.name: each.unit for each in thing.regions}
        varying = {each.name: units[each.parameters[0]] for each in thing.may_vary}
    places = {
        **{each.name: each.unit for each in thing.equations},
        **{f"reading of {each.channel}": each.unit for each in thing.outputs},
        **varying,
    }
    return Vocabulary(places, {**regions, "time": "s"}, list(places), _DIRECTION in regions)


def read_additions(root: Located, known: Vocabulary) -> list[Addition]:
    """Return the additions under the key `discovered` of a model file; record the problems.

    An addition with a mistake is left out. `known` is the vocabulary of the plant.
    """
    section = root.get(KEY)
    if section is None or section.value == "none":
        return []
    entries = section.elements()
    if not isinstance(section.value, list) or len(entries) > SLOTS:
        section.refuse(f"is not a list of at most {SLOTS} terms", _EXAMPLE)
    terms = [read_term(entry, known) for entry in entries]
    return [as_addition(term) for term in terms if term is not None]


def written_additions(plant: Plant, values: Mapping[str, float]) -> Iterator[str]:
    """Yield the lines of a model file that give a plant's additions; none if there are none.

    `values` are the values of all parameters by name, SI, those of the plant's slots included,
    which hold the additions.
    """
    if plant.layout is not None:
        terms = [as_term(each) for each in plant.layout.additions(values)]
        yield from lines_of(terms, vocabulary(plant))
