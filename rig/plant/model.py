"""A model of one rig: its parameters, the effects that are switched on, and its provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from .added_terms import AddedTerm
from .effects import CATALOGUE
from .parameters import Parameters


@dataclass(frozen=True)
class Model:
    """A model of one rig.

    Attributes:
        name: name of the model.
        parameters: parameters of the rig, SI, with the terms that the plant holds.
        effects: names of the effects switched on.
        provenance: where the model comes from.
        discovered: terms that the plant cannot hold (`rig.plant.is_held`); simulator and filters
            ignore them.
    """

    name: str = "nominal"
    parameters: Parameters = Parameters()
    effects: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    discovered: tuple[AddedTerm, ...] = ()

    def with_effect(self, name: str, **values: float) -> "Model":
        """Return a copy of this model with an effect of the catalogue switched on.

        An effect that shifts a parameter which every rig has is given the new value itself, not a
        difference (`bulk_modulus`: beta). `coulomb_level` also changes the stiction in proportion,
        and `stiction_level` the stiction alone; of the two, it must therefore be set last.

        Args:
            name: name of the effect.
            **values: SI value of each of its knobs to set, by the knob's name; the other knobs stay
                as they are, and ranges are not checked.

        Raises:
            KeyError: the effect, or one of its knobs, is not in the catalogue.
        """
        parameters = CATALOGUE[name].applied(self.parameters, **values)
        effects = self.effects if name in self.effects else (*self.effects, name)
        return replace(self, parameters=parameters, effects=effects)
