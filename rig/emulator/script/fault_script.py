"""Reads the faults of an emulated rig from a script, or a single fault from a request.

A script is a YAML file with a list `faults`; each entry names its `fault`, and when it begins and
ends. The reset button is pressed only if the script says that the `operator` is attentive:

    operator: attentive
    faults:
      - {fault: delay, target: daq, by: 5 ms, after: enable, at: 2 s, for: 500 ms}
      - {fault: sensor, target: pressure_1_Pa, reads: high, at: 10 s}
"""

from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import create_model

from rig.configuration import (
    Located,
    Physical,
    Place,
    Schema,
    Sources,
    elements_of,
    read_mapping,
    read_options,
    suggestion,
)

from .wire_faults import KINDS, Start, WireFault

ATTENTIVE: Final = Path(__file__).with_name("attentive.yaml")
"""File of the script that is used if no other one is given."""

_TIMES: Final = ("at", "after", "for")
_TIMES_SCHEMA: Final = create_model(
    "WireFaultFile",
    __base__=Schema,
    # `for` is no name that a class body could hold.
    **{  # type: ignore[call-overload]
        "fault": (str, ...),
        "at": (Annotated[float, Physical("s", 0.0, 1e6, 1.0)], 0.0),
        "after": (Start, "start"),
        "for": (Annotated[float, Physical("s", 1e-3, 1e6, 1.0)], inf),
    },
)


class Script(NamedTuple):
    """The faults of an emulated rig, and how its operator behaves.

    Attributes:
        faults: the faults in the order of the file.
        attentive: whether the operator presses the reset button whenever its lamp is lit.
    """

    faults: tuple[WireFault, ...] = ()
    attentive: bool = False


NOTHING: Final = Script()
"""A script without faults, whose operator presses no button."""


class ScriptFile(Schema):
    """The keys of a script file."""

    operator: Literal["attentive", "away"] = "away"
    faults: Any


def read_script(path: Path) -> Script:
    """Return the script in a file.

    Raises:
        ConfigError: the file is not valid; the error names every problem.
    """
    sources = Sources()
    root = sources.read_yaml(path)
    file = read_mapping(ScriptFile, root)
    remedy = "write `faults:` and a list: - {fault: ..., at: ...}"
    entries = elements_of(root.get("faults") if root is not None else None, remedy)
    found = [read_fault(item) for item in entries]
    file = sources.finished(file)
    faults = tuple(fault for fault in found if fault is not None)
    return Script(faults, file.operator == "attentive")


def fault_from(request: Mapping[str, Any]) -> WireFault:
    """Return a fault given as plain values, with the keys of a script.

    Raises:
        ConfigError: the fault is not valid; the error names every problem.
    """
    sources = Sources()
    return sources.finished(read_fault(_located(request, "request", sources)))


def _located(value: Any, name: str, sources: Sources) -> Located:
    """Return plain values as if they had been read from a file named `request`."""
    if isinstance(value, Mapping):
        value = {str(k): _located(v, str(k), sources) for k, v in value.items()}
    elif isinstance(value, list):
        value = [_located(v, f"{name}[{i}]", sources) for i, v in enumerate(value)]
    return Located(value, Place(Path("request"), 0, 0), name, sources)


def read_fault(item: Located) -> WireFault | None:
    """Return one fault; if it is not valid, return None and record its problems."""
    entry = item.get("fault")
    if entry is None or str(entry.value) not in KINDS:
        value = entry.shown if entry else ""
        remedy = suggestion(value, tuple(KINDS), "faults")
        (entry or item).refuse("is not a known fault", remedy, value, name="fault")
        return None
    keys = dict(item.items())
    own = {key: keys.pop(key) for key in ("fault", *_TIMES) if key in keys}
    times = read_mapping(_TIMES_SCHEMA, item.with_value(own))
    options = read_options(KINDS[str(entry.value)], item.with_value(keys))
    if times is None or options is None:
        return None
    given = times.model_dump()
    return WireFault(given["fault"], options, given["at"], given["after"], given["for"])
