"""A model of one rig: its parameters, which effects are switched on, and where it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .effects import CATALOGUE
from .parameters import Parameters


@dataclass(frozen=True)
class Model:
    """Parameters of a rig (SI) with the names of the effects switched on and their provenance."""

    name: str = "nominal"
    parameters: Parameters = Parameters()
    effects: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def with_effect(self, name: str, **values: float) -> "Model":
        """Return this model with one more effect of the catalogue, its parameters given in SI.

        An effect that shifts a parameter which every rig has sets it (`bulk_modulus`: beta itself).
        `coulomb_level` takes the stiction along in proportion; `stiction_level` is the stiction
        alone, so that it has to be the last of the two.

        Raises:
            KeyError: the effect, or one of its parameters, is not in the catalogue.
        """
        parameters = CATALOGUE[name].applied(self.parameters, **values)
        effects = self.effects if name in self.effects else (*self.effects, name)
        return Model(self.name, parameters, effects, self.provenance)
