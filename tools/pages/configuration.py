"""Writes the tables of keys in docs/configuration.md, from the classes that hold the keys' values.

Run as `python -m tools.pages.configuration`. The text between the tables is written by hand.
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from types import EllipsisType
from typing import Any, Final, Literal, get_args, get_origin

from control import ControlSettings
from rig.configuration.reading.options import Option, kind_of, options_of
from rig.configuration.reading.quantities import show
from rig.io.modbus_daq.register_map import RegisterMap
from rig.io.registry import driver_class
from rig.io.settings import HomingSettings, LoopSettings
from rig.io.wiring import Wiring

PAGE: Final = Path(__file__).parents[2] / "docs" / "configuration.md"

_TABLE: Final = re.compile(r"(<!-- keys of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_MEANING: Final = re.compile(r"^ {4}(\w+): (.*?)(?=^ {4}\w+: |\Z|^\S)", re.DOTALL | re.MULTILINE)
_SECTIONS: Final = {
    "loop": LoopSettings,
    "homing": HomingSettings,
    "wiring": Wiring,
    "control": ControlSettings,
    "register_map": RegisterMap,
}


def main() -> None:
    """Write the tables of keys in docs/configuration.md anew; the other text stays."""
    PAGE.write_text(updated(PAGE.read_text()))


def updated(page: str) -> str:
    """Return the text of `page`, in which every table of keys is written anew from its class."""

    def table(match: re.Match[str]) -> str:
        return match[1] + "\n" + "\n".join(keys_table(match[2])) + "\n\n" + match[3]

    return _TABLE.sub(table, page)


def keys_table(section: str) -> Iterator[str]:
    """Yield the lines of one table of keys in Markdown.

    Args:
        section: a section of the rig file (`loop`, `homing`, `wiring`, `control`),
            `register_map`, or a type of driver.

    Raises:
        DriverError: the section is none of these, or the driver is broken.
    """
    options: type = _SECTIONS.get(section) or driver_class(section).Options
    meanings = _meanings(options)
    yield "| key | value | if not given | meaning |"
    yield "|---|---|---|---|"
    for name, option in options_of(options).items():
        usual = _default(option)
        yield f"| `{name}` | {_values(option)} | {usual} | {meanings.get(name, '')} |"


def _meanings(options: type) -> dict[str, str]:
    """Return the description of each field, by name, from the docstrings of a class and its bases.

    Where several classes describe a field, the most derived one counts.
    """
    found: dict[str, str] = {}
    for base in options.__mro__[-2::-1]:
        _, _, attributes = (inspect.getdoc(base) or "").partition("Attributes:\n")
        for name, text in _MEANING.findall(attributes):
            found[name] = " ".join(text.split()).rstrip(".")
    return found


def _values(option: Option) -> str:
    kind, quantity = kind_of(option), option.quantity
    if quantity is not None and kind is int:
        return f"{int(quantity.lower)} to {int(quantity.upper)}"
    if quantity is not None:
        return f"{show(quantity.lower, quantity.unit)} to {show(quantity.upper, quantity.unit)}"
    if get_origin(kind) is Literal:
        return ", ".join(f"`{choice}`" for choice in get_args(kind))
    words = {str: "text", int: "whole number", bool: "true, false", Path: "name or path"}
    if kind in words:
        return words[kind]
    return "list" if get_origin(kind) is tuple else "mapping, or name or path of a map"


def _default(option: Option) -> str:
    default: Any = option.default
    if isinstance(default, EllipsisType):
        return "required"
    if default is None or default in ("", ()) or is_dataclass(default):
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, float) and option.quantity is not None:
        return show(default, option.quantity.unit)
    return ", ".join(default) if isinstance(default, tuple) else str(default)


if __name__ == "__main__":
    main()
