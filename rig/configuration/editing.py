"""JSON schemas of files that people write, by which editors complete and check them.

They follow from the classes by which the files are read, so that no key is written twice. An editor
cannot see all that `rig check` sees, such as the limits of the rig.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from faults import MEASURES
from rig.configuration.campaigns import CampaignFile
from rig.configuration.reading import AnyQuantity, Field, Physical, Schema, Under
from rig.configuration.rigs import RigFile, TransducerFile
from rig.configuration.sweeps import SweepFile

EDITED: Final[dict[str, type[Schema]]] = {
    "campaign": CampaignFile,
    "rig": RigFile,
    "sweep": SweepFile,
    "transducer": TransducerFile,
}
"""Kinds of files that have a schema for editors -> the class of their keys."""

_DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"
_REFERENCE: Final = {"type": "string", "pattern": r"\$\{"}
"""A reference to an axis of a matrix, which may stand for any value of a test."""


_UNITS_OF_CHANNELS: Final = ("m", "V", "Pa", "N", "K", "s")
"""Units that the names of channels end with, as `unit_of` reads them."""


def _unit_rules(keys: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any], str]]:
    """Yield (key, schema of its value, SI unit) by which the unit of bounds is known.

    A limit that has a figure beside a channel is that of the channel, as of a peak.
    """
    if "channel" in keys:
        for unit in _UNITS_OF_CHANNELS:
            # What ends in a unit per another, such as _m3_per_s, is not in the last one.
            yield "channel", {"type": "string", "pattern": rf"^(?!.*_per_).*_{unit}$"}, unit
    if "figure" in keys:
        for unit in dict.fromkeys(MEASURES.values()):
            names = [name for name, of in MEASURES.items() if of == unit]
            names = [name for name in names if name not in ("peak", "valley")]
            yield "figure", {"enum": names}, unit


def editor_schema(kind: str) -> dict[str, Any]:
    """Return the JSON schema of a kind of file, one of `EDITED`, as JSON-able values."""
    writer = _Writer(references=kind == "campaign")
    root = writer.of(EDITED[kind])
    if kind == "rig":
        # All other keys may be the parent's.
        writer.definitions[EDITED[kind].__name__]["required"] = ["name"]
    return {"$schema": _DRAFT, "title": f"rig: {kind} file", **root, "$defs": writer.definitions}


class _Writer:
    """Writes the schema of classes of keys, each once, under `$defs`.

    Args:
        references: whether any value may also be a reference to an axis of a matrix.

    Attributes:
        definitions: name -> schema.
    """

    def __init__(self, *, references: bool) -> None:
        self.definitions: dict[str, Any] = {}
        self._references = references

    def of(self, model: type[Schema], *, optional: bool = False) -> dict[str, Any]:
        """Return a reference to the schema of a class; with `optional`, no key is required."""
        name = model.__name__ + ("Defaults" if optional else "")
        if name not in self.definitions:
            self.definitions[name] = {}
            self.definitions[name] = self._object(model, optional=optional)
        return {"$ref": f"#/$defs/{name}"}

    def _object(self, model: type[Schema], *, optional: bool) -> dict[str, Any]:
        written = model.model_json_schema()
        for name, definition in written.get("$defs", {}).items():
            self.definitions.setdefault(name, definition)
        keys = {
            name: self._value(model, name, schema) for name, schema in written["properties"].items()
        }
        found: dict[str, Any] = {
            "type": "object",
            "description": (model.__doc__ or "").partition("\n")[0],
            "properties": keys,
            "additionalProperties": False,
        }
        if not optional and written.get("required"):
            found["required"] = written["required"]
        bounds = [
            name
            for name, field in model.model_fields.items()
            if any(isinstance(each, AnyQuantity) for each in field.metadata)
        ]
        if bounds and ("channel" in keys or "figure" in keys):
            found["allOf"] = [self._unit_of_bounds(*each, bounds) for each in _unit_rules(keys)]
        return found

    def _unit_of_bounds(
        self, key: str, which: Mapping[str, Any], unit: str, bounds: list[str]
    ) -> dict[str, Any]:
        """Return that the bounds of a limit are in a unit if a key has one of some values."""
        quantity: Any = Physical(unit).json_schema()
        quantity = {"anyOf": [quantity, _REFERENCE, {"type": "null"}]}
        return {
            "if": {"required": [key], "properties": {key: dict(which)}},
            "then": {"properties": dict.fromkeys(bounds, quantity)},
        }

    def _value(self, model: type[Schema], name: str, schema: Mapping[str, Any]) -> Any:
        metadata = model.model_fields[name].metadata
        under = next((each for each in metadata if isinstance(each, Under)), None)
        if under is not None:
            return self._under(under)
        plain = {key: value for key, value in schema.items() if key != "title"}
        if any(isinstance(each, Field) for each in metadata):
            # It is what is made of the text in a file, such as a number in SI.
            plain.pop("default", None)
        takes_texts = plain.get("type") == "string" and not {"enum", "pattern"} & plain.keys()
        if not self._references or not plain or takes_texts:
            return plain
        return {"anyOf": [plain, _REFERENCE]}

    def _under(self, under: Under) -> Any:
        choices = [self.of(model, optional=under.optional) for model in under.schemas()]
        one: Any = choices[0] if len(choices) == 1 else {"anyOf": choices}
        if under.named:
            one = {"type": "object", "additionalProperties": one}
            if under.names:
                one = {
                    "type": "object",
                    "properties": dict.fromkeys(under.names, one["additionalProperties"]),
                    "additionalProperties": False,
                }
        if under.many:
            several = {"type": "array", "items": one}
            one = {"anyOf": [one, several]} if under.or_one else several
        also = [{"const": word} for word in under.words]
        if under.text:
            also.append({"type": "string"})
        elif self._references:
            also.append(_REFERENCE)
        return {"anyOf": [one, *also]} if also else one
