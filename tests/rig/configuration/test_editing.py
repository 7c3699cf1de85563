"""The schema of an editor takes what the readers take, and refuses what is misspelt."""

import json
import re
from collections.abc import Iterator
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from rig.cli.schema import command
from rig.configuration.editing import EDITED, editor_schema
from rig.configuration.reading import Schema, Under
from rig.configuration.reading.lookup import shipped_config_dir
from rig.configuration.reading.quantities import DIMENSIONS, unit_factor
from rig.configuration.reading.unit_patterns import known_units, quantity_pattern

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
    if "pattern" in schema and isinstance(value, str) and not re.search(schema["pattern"], value):
        return [f"{at}: {value} does not match"]
    if isinstance(value, int | float):
        least, most = schema.get("minimum", -inf), schema.get("maximum", inf)
        if not least <= value <= most:
            return [f"{at}: {value} is not within {least} to {most}"]
    found: list[str] = []
    for each in schema.get("allOf", []):
        if not mistakes(value, each.get("if", {}), root, at):
            found += mistakes(value, each["then"], root, at)
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
        least, most = schema.get("minItems", 0), schema.get("maxItems", inf)
        if not least <= len(value) <= most:
            found.append(f"{at}: {len(value)} items are not {least} to {most}")
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


DOCS = Path(__file__).parents[3] / "docs"
PARTS = (("campaign", "CampaignFile"), ("campaign", "CampaignTestFile"), ("rig", "RigFile"))


schema_of = cache(editor_schema)
"""The schema of a kind of file, made once."""


@cache
def examples() -> list[Any]:
    """Return every example in the documentation that is a part of a campaign or of a rig.

    Each is (classes of keys that it may be of, mapping). The page of drivers has one of the
    reader's own, which no schema knows before it is installed.
    """
    found = []
    for page in sorted(DOCS.glob("*.md")):
        text = "" if page.stem == "drivers" else page.read_text()
        for number, block in enumerate(re.findall(r"^```[a-z]*\n(.*?)^```", text, re.M | re.S)):
            try:
                value = loaded(block)
            except yaml.YAMLError:
                continue
            if isinstance(value, dict) and value:
                of = [(kind, name) for kind, name in PARTS if value.keys() <= keys_of(kind, name)]
                if of:
                    found.append(pytest.param(of, value, id=f"{page.stem}-{number}"))
    return found


def keys_of(kind: str, name: str) -> set[str]:
    return set(schema_of(kind)["$defs"][name]["properties"])


@pytest.mark.parametrize(("of", "value"), examples())
def test_an_example_of_the_documentation_is_valid(of: list[tuple[str, str]], value: Any) -> None:
    found = []
    for kind, name in of:
        schema = schema_of(kind)
        whole = mistakes(value, schema["$defs"][name], schema)
        found.append([each for each in whole if ": lacks " not in each])
    assert [] in found, found


def test_the_documentation_has_examples_of_every_part() -> None:
    assert {part for each in examples() for part in each.values[0]} == set(PARTS)


@pytest.mark.parametrize("si_unit", sorted(DIMENSIONS))
def test_every_unit_that_an_editor_takes_is_read(si_unit: str) -> None:
    pattern = quantity_pattern(si_unit)
    for unit in known_units(si_unit):
        assert unit_factor(unit, si_unit) > 0
        assert re.search(pattern, f"1.5e-3 {unit}")
    assert not re.search(pattern, f"1.5 {'V' if si_unit != 'V' else 'm'}")
    assert bool(re.search(pattern, "1.5")) == (si_unit in ("", "rad"))


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        ("campaign", "{name: a, rig: b, tests: [], onfault: trip}", "onfault is not known"),
        ("campaign", "{name: a, rig: b}", "lacks tests"),
        ("campaign", "{name: a, rig: b, tests: [{name: c, cycles: many}]}", ""),
        ("campaign", "{name: a, rig: b, tests: [{name: c, limits: [{chanel: x}]}]}", "chanel"),
        ("campaign", "{name: a, rig: b, tests: [{name: c, on_fault: stop}]}", ""),
        ("campaign", "{name: a, rig: b, tests: [{name: c, setpoint: {type: sign}}]}", ""),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, duration: 40}]}",
            "duration: 40 is no",
        ),
        ("campaign", "{name: a, rig: b, tests: [{name: c, duration: 40 m}]}", "40 m does not"),
        ("campaign", "{name: a, rig: b, tests: [{name: c, duration: -40 s}]}", "-40 s does not"),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, faults: [{type: internal_leakage, at: 5 s, "
            "needle_opening: 1.5}]}]}",
            "1.5 is not within 0.0 to 1.0",
        ),
        (
            "campaign",
            "{name: a, rig: b, detector: {false_alarms_per_day: 0}, tests: []}",
            "is not within 0.001",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, setpoint: {type: triangle, mean: 0.3 m, "
            "amplitude: 15 mm, frequency: 0.25 s}}]}",
            "0.25 s does not match",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, setpoint: {type: trapezoid, mean: 0.3 m, "
            "amplitude: 15 mm, frequency: 0.25 Hz, holds: 1 s}}]}",
            "",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, segments: [{loop: 3, segments: [{hold: 3}]}]}]}",
            "3 is no",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, segments: [{wait_for: {channel: x_m}}]}]}",
            "lacks at_most",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, criteria: [{figure: rms_error, at_most: 3 V}]}]}",
            "3 V does not match",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, limits: [{channel: position_m, low: 5}]}]}",
            "5 is no",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, limits: [{channel: load_N, inner_low: 5 MPa}]}]}",
            "5 MPa does not match",
        ),
        (
            "campaign",
            "{name: a, rig: b, tests: [{name: c, limits: [{figure: lag, high: 5 mm, "
            "action: stop}]}]}",
            "stop is no choice",
        ),
        (
            "rig",
            "{name: a, limits: {channels: [{channel: load_N, high: 5 V, action: trip}]}}",
            "5 V",
        ),
        ("rig", "{name: a, loop: {rate: 1000 s}}", "1000 s does not match"),
        ("rig", "{name: a, drivers: {daq: {driver: modbus}}}", ""),
        ("rig", "{name: a, loop: {prioritty: 3}}", "prioritty is not known"),
        ("rig", "{name: a, limits: {position: 3 m}}", ""),
    ],
)
def test_what_is_misspelt_is_refused(kind: str, text: str, said: str) -> None:
    schema = schema_of(kind)
    found = mistakes(loaded(text), schema, schema)
    assert found
    assert said in "\n".join(found)


FREE = {
    ("CampaignTestFile", "matrix"), ("PlantFile", "parameters"),
    ("PlantFile", "effects"),
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
    bounds = {"path", "map"}
    assert {key for key in free if key[1] not in bounds} <= FREE | {
        key for key in free if key[0].endswith(("driver", "OptionsFile"))
    }


@pytest.mark.parametrize("kind", EDITED)
def test_the_command_writes_it(kind: str) -> None:
    result = CliRunner().invoke(command, [kind], standalone_mode=False)
    assert json.loads(result.output) == schema_of(kind)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("uniform: [0.2 Hz, 1 Hz]", "uniform: [0.2 Hz]"),
        ("uniform: [0.2 Hz, 1 Hz]", "uniformly: [0.2 Hz, 1 Hz]"),
        ("uniform: [0.2 Hz, 1 Hz]", "uniform: [0.2 m, 1 m]"),
        ("type: multisine", "type: multisin"),
        ("healthy: 25 %", "health: 25 %"),
        ("coulomb: {uniform", "columb: {uniform"),
        ("frequencies: {uniform: [0.1 Hz, 2 Hz]}", "frequencies: [1 m]"),
        ("spring_load: {stiffness", "spring_load: {stifness"),
    ],
)
def test_a_slip_in_a_sweep_is_refused(old: str, new: str) -> None:
    text = (shipped_config_dir() / "sweeps" / "detector.yaml").read_text()
    assert old in text
    schema = schema_of("sweep")
    assert mistakes(loaded(text), schema, schema) == []
    assert mistakes(loaded(text.replace(old, new, 1)), schema, schema)
