"""Writes the model file of a plant from outside, in the form in which `plant_file` reads it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from estimator.gap import Parameter

from .model_writing import plain_provenance
from .plant_file import PlantModel, catalogue, own_parameters

REVISED: Final = "revised"
_COMMENT_COLUMN: Final = 48
_CARRIED: Final = ("channels", "tolerances", "model_error", "steering")


def write_plant_file(
    model: PlantModel, values: Mapping[str, float], effects: tuple[str, ...], provenance: Any,
    path: Path,
) -> None:  # fmt: skip
    """Write a model file with given values of all parameters; it reads back to the same floats.

    Effects are those of the model and those given. Intervals that the provenance tells of
    (`effects`, `refitted`: key -> value, lower, upper) are told beside the values too, but for
    what was refitted and not kept (`kept`). A model whose values are as they were keeps its name.

    Args:
        model: as read.
        values: of all parameters by name, SI.
        effects: names of those added.
        provenance: what to tell of the values' origin.
        path: of the file, replaced.
    """
    names = [*model.effects, *(name for name in effects if name not in model.effects)]
    on = {name: keys for name, keys in catalogue(model.plant).items() if name in names}
    told = _Told(values, model.plant.parameters, provenance)
    same = dict(values) == model.plant.nominal and not effects
    revised = same or model.name.endswith(f" {REVISED}")
    name = model.name if revised else f"{model.name} {REVISED}"
    header = {"name": name, "description": model.told.get("description")}
    lines = [_dumped({key: value for key, value in header.items() if value})]
    lines += ["parameters:"]
    under_effects = {parameter for keys in on.values() for parameter in keys.values()}
    for each in own_parameters(model.plant):
        if each.name not in under_effects:
            lines.append(told.line("  ", each.name, each.name, told.refitted.get(each.name)))
    if on:
        lines.append("effects:")
    for effect, keys in on.items():
        intervals = told.intervals(effect)
        if list(keys) == ["value"]:
            lines.append(told.line("  ", effect, keys["value"], intervals.get("value")))
            continue
        lines.append(f"  {effect}:")
        lines += [told.line("    ", k, p, intervals.get(k)) for k, p in keys.items()]
    lines += _carried(model.told)
    if provenance:
        lines.append(_dumped({"provenance": plain_provenance(provenance)}))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


class _Told:
    """Lines of values with their units, symbols and intervals."""

    def __init__(
        self, values: Mapping[str, float], parameters: tuple[Parameter, ...], provenance: Any
    ) -> None:
        self.values = values
        self.known = {parameter.name: parameter for parameter in parameters}
        self.provenance = provenance if isinstance(provenance, Mapping) else {}
        refitted: Mapping[str, Any] = self.provenance.get("refitted") or {}
        self.refitted = {key: each for key, each in refitted.items() if each.get("kept", True)}

    def intervals(self, effect: str) -> Mapping[str, Any]:
        told = (self.provenance.get("effects") or {}).get(effect) or {}
        return dict(told.get("parameters") or {})

    def line(self, indent: str, key: str, parameter: str, interval: Any) -> str:
        each = self.known[parameter]
        text = f"{indent}{key}: {float(self.values[parameter])!r} {each.unit}".rstrip()
        comment = [each.about] if each.about else []
        ends = [interval.get(end) for end in ("lower", "upper")] if interval else []
        if ends and None not in ends:
            comment.append(f"95 %: {ends[0]:.6g} to {ends[1]:.6g} {each.unit}".rstrip())
        return f"{text:<{_COMMENT_COLUMN}} # {'; '.join(comment)}" if comment else text


def _carried(told: Mapping[str, Any]) -> Iterator[str]:
    """Yield the sections that a revision does not change."""
    for key in _CARRIED:
        if told.get(key) is not None:
            yield _dumped({key: told[key]})


def _dumped(content: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100).rstrip()
