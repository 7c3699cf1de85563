"""What an editor is told of the keys of a sweep whose values have readers of their own."""

from dataclasses import dataclass
from typing import Any

from rig.configuration.models import PARAMETERS, physical
from rig.configuration.reading import Adjustable, Field
from rig.plant import CATALOGUE, REMEMBERING

from .distributions import Random


class _AsGiven(Field):
    """The annotation of a value that is passed on as it is, to a reader of its own."""

    def parse(self, raw: object) -> Any:
        """Return the value as it is."""
        return raw


def _drawn(field: str) -> dict[str, Any]:
    """Return the JSON schema of a parameter of the plant that may be drawn."""
    return Random(Adjustable(physical(field))).json_schema()


def _keys(schemas: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": schemas, "additionalProperties": False}


class DrawnParameters(_AsGiven):
    """The annotation of `parameters`, a mapping of quantities that may be drawn."""

    def json_schema(self) -> dict[str, Any]:
        """Return every parameter that a sweep may draw, with its quantity."""
        return _keys({name: _drawn(name) for name in PARAMETERS if name not in REMEMBERING})


class DrawnEffects(_AsGiven):
    """The annotation of `effects`, whose parameters may be drawn."""

    def json_schema(self) -> dict[str, Any]:
        """Return every effect that a sweep may have: its parameters, or its only value."""
        effects: dict[str, Any] = {}
        for name, effect in CATALOGUE.items():
            if any(each.field in REMEMBERING for each in effect.parameters):
                continue
            keys = {each.name: _drawn(each.field) for each in effect.parameters}
            alone = [keys["value"]] if "value" in keys else []
            effects[name] = {"anyOf": [_keys(keys), *alone]}
        return _keys(effects)


@dataclass(frozen=True)
class DrawnList(_AsGiven):
    """The annotation of a list of quantities that may be drawn each, or of one for all.

    Attributes:
        one: the annotation of each.
    """

    one: Random

    def json_schema(self) -> dict[str, Any]:
        """Return a list of quantities, or one quantity."""
        one = self.one.json_schema()
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}
