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
    shown,
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
    file: ScriptFile | None = None
    faults: list[WireFault] = []
    if root is not None:
        file = read_mapping(ScriptFile, root, sources.problems)
        remedy = "write `faults:` and a list: - {fault: ..., at: ...}"
        entries = elements_of(root.get("faults"), sources.problems, remedy)
        faults = [fault for item in entries if (fault := read_fault(item, sources))]
    sources.problems.raise_if_any()
    assert file is not None
    return Script(tuple(faults), file.operator == "attentive")


def fault_from(request: Mapping[str, Any]) -> WireFault:
    """Return a fault given as plain values, with the keys of a script.

    Raises:
        ConfigError: the fault is not valid; the error names every problem.
    """
    sources = Sources()
    fault = read_fault(_located(request, "request"), sources)
    sources.problems.raise_if_any()
    assert fault is not None
    return fault


def _located(value: Any, name: str) -> Located:
    """Return plain values as if they had been read from a file named `request`."""
    place = Place(Path("request"), 0, 0)
    if isinstance(value, Mapping):
        return Located({str(k): _located(v, str(k)) for k, v in value.items()}, place, name)
    if isinstance(value, list):
        return Located([_located(v, f"{name}[{i}]") for i, v in enumerate(value)], place, name)
    return Located(value, place, name)


def read_fault(item: Located, sources: Sources) -> WireFault | None:
    """Return one fault; if it is not valid, return None and add its problems to `sources`."""
    entry = item.get("fault")
    if entry is None or str(entry.value) not in KINDS:
        place, value = (entry.place, shown(entry)) if entry else (item.place, "")
        remedy = suggestion(value, tuple(KINDS), "faults")
        sources.problems.add(place, "fault", value, "is not a known fault", remedy)
        return None
    keys = dict(item.items())
    own = {key: keys.pop(key) for key in ("fault", *_TIMES) if key in keys}
    times = read_mapping(_TIMES_SCHEMA, Located(own, item.place, item.name), sources.problems)
    options = read_options(KINDS[str(entry.value)], Located(keys, item.place, item.name), sources)
    if times is None or options is None:
        return None
    given = times.model_dump()
    return WireFault(given["fault"], options, given["at"], given["after"], given["for"])
