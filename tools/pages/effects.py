"""Writes the table of effects in docs/model.md; run as `python -m tools.pages.effects`."""

from pathlib import Path
from typing import Final

from rig.plant import CATALOGUE, EffectParameter, PlantEffect

from .marked_tables import fill, markdown

PAGE: Final = Path(__file__).parents[2] / "docs" / "model.md"
NAME: Final = "effects"


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|")


def _knob(knob: EffectParameter) -> str:
    return f"{knob.name}: {_code(knob.field)}"


def _in_lines(effect: PlantEffect, cell: str) -> str:
    """Return a table cell with one line for each parameter of an effect.

    `cell` is the format of a line, in which `knob` stands for the parameter.
    """
    return "<br>".join(cell.format(knob=knob) for knob in effect.parameters)


def effects_table() -> str:
    """Return the table of all effects of the catalogue in Markdown, one row for each.

    Its columns are name, equation, parameters, units, neutral values, plausible bounds and source.
    The neutral value of a parameter that every rig has is given as "the model's".
    """
    rows = []
    for effect in CATALOGUE.values():
        neutral = "<br>".join(
            "the model's" if knob.shift else f"{knob.neutral:g}" for knob in effect.parameters
        )
        rows.append(
            (
                _code(effect.name),
                _code(effect.equation),
                "<br>".join(_knob(knob) for knob in effect.parameters),
                _in_lines(effect, "{knob.unit}") or "-",
                neutral,
                _in_lines(effect, "{knob.lower:g} to {knob.upper:g}"),
                effect.source.replace("|", "\\|"),
            )
        )
    head = ("effect", "term", "parameters: field", "unit", "neutral", "plausible", "source")
    return markdown(head, rows)


def main() -> None:
    """Write the table of effects in docs/model.md anew."""
    fill(PAGE, {NAME: effects_table()})


if __name__ == "__main__":
    main()
