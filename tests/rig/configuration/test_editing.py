"""The schema of an editor takes what the readers take, and refuses what is misspelt."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from rig.cli.schema import command
from rig.configuration.editing import EDITED, editor_schema
from rig.configuration.reading import Schema, Under
from rig.configuration.reading.lookup import shipped_config_dir

TYPES: dict[str, Any] = {
    "object": dict, "array": list, "string": str, "boolean": bool, "integer": int,
    "number": (int, float), "null": type(None),
}  # fmt: skip


def mistakes(value: Any, schema: dict[str, Any], root: dict[str, Any], at: str = "") -> list[str]:
    """Return what a validator finds, for the words of JSON Schema that are used here."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return mistakes(value, root["$defs"][name], root, at)
    if "anyOf" in schema:
        tried = [mistakes(value, each, root, at) for each in schema["anyOf"]]
        return min(tried, key=len)
    if "const" in schema:
        return [] if value == schema["const"] else [f"{at}: not {schema['const']}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{at}: {value} is no choice"]
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(
        isinstance(value, TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))
        for kind in kinds
    ):
        return [f"{at}: {value!r} is no {kinds}"]
    if "pattern" in schema and not re.search(schema["pattern"], value):
        return [f"{at}: {value} does not match"]
    found: list[str] = []
    if isinstance(value, dict):
        found += [f"{at}: lacks {key}" for key in schema.get("required", []) if key not in value]
        known, more = schema.get("properties", {}), schema.get("additionalProperties", {})
        for key, each in value.items():
            inner = known.get(key, more)
            if inner is False:
                found.append(f"{at}: {key} is not known")
            elif isinstance(inner, dict):
                found += mistakes(each, inner, root, f"{at}/{key}")
    if isinstance(value, list):
        for index, each in enumerate(value):
            found += mistakes(each, schema.get("items", {}), root, f"{at}[{index}]")
    return found


def shipped(kind: str) -> list[Path]:
    return sorted((shipped_config_dir() / f"{kind}s").glob("*.yaml"))


def loaded(text: str) -> Any:
    # As JSON would hold it: dates are texts.
    return json.loads(json.dumps(yaml.safe_load(text), default=str))


@pytest.mark.parametrize(
    ("kind", "path"), [(kind, path) for kind in EDITED for path in shipped(kind)], ids=str
)
def test_every_shipped_file_is_valid(kind: str, path: Path) -> None:
    schema = editor_schema(kind)
    assert mistakes(loaded(path.read_text()), schema, schema) == []


def test_the_example_of_the_campaigns_page_is_valid() -> None:
    page = (Path(__file__).parents[3] / "docs" / "campaigns.md").read_text()
    (example,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    schema = editor_schema("campaign")
    assert mistakes(loaded(example), schema, schema) == []


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        ("campaign", "{name: a, rig: b, tests: [], onfault: trip}", "onfault is not known"),
        ("campaign", "{name: a, rig: b}", "lacks tests"),
        ("campaign", "{name: a, rig: b, tests: [{name: c, cycles: many}]}", ""),
        ("campaign", "{name: a, rig: b, tests: [{name: c, limits: [{chanel: x}]}]}", "chanel"),
        ("campaign", "{name: a, rig: b, tests: [{name: c, on_fault: stop}]}", ""),
        ("campaign", "{name: a, rig: b, tests: [{name: c, setpoint: {type: sign}}]}", ""),
        ("rig", "{name: a, drivers: {daq: {driver: modbus}}}", ""),
        ("rig", "{name: a, loop: {prioritty: 3}}", "prioritty is not known"),
        ("rig", "{name: a, limits: {position: 3 m}}", ""),
    ],
)
def test_what_is_misspelt_is_refused(kind: str, text: str, said: str) -> None:
    schema = editor_schema(kind)
    found = mistakes(loaded(text), schema, schema)
    assert found
    assert said in "\n".join(found)


FREE = {
    ("FaultFile", "coefficient"), ("CampaignTestFile", "matrix"), ("PlantFile", "parameters"),
    ("PlantFile", "effects"),
    *(("ProfileEntryFile", key) for key in ("until", "ramp", "needle_opening", "coefficient",
                                            "linear_coefficient", "flow", "pressure")),
    *(("CriterionFile", key) for key in ("at_least", "at_most")),
}  # fmt: skip
"""Keys of which an editor knows no more than their names."""


def classes(model: type[Schema], seen: set[type[Schema]]) -> Iterator[type[Schema]]:
    if model.__name__ in {each.__name__ for each in seen}:
        return
    seen.add(model)
    yield model
    for field in model.model_fields.values():
        for under in field.metadata:
            if isinstance(under, Under):
                for inner in under.schemas():
                    yield from classes(inner, seen)


@pytest.mark.parametrize("kind", EDITED)
def test_no_mapping_of_a_file_is_left_out(kind: str) -> None:
    free = {
        (model.__name__, name)
        for model in classes(EDITED[kind], set())
        for name, field in model.model_fields.items()
        if field.annotation is Any and not field.metadata
    }
    bounds = {"low", "high", "hysteresis", "inner_low", "inner_high", "path", "map"}
    assert {key for key in free if key[1] not in bounds} <= FREE | {
        key for key in free if key[0].endswith(("driver", "OptionsFile"))
    }


@pytest.mark.parametrize("kind", EDITED)
def test_the_command_writes_it(kind: str) -> None:
    result = CliRunner().invoke(command, [kind], standalone_mode=False)
    assert json.loads(result.output) == editor_schema(kind)
