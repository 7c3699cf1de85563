"""Checks of a plant's description: they report all problems at once, each with its place."""

import math
import traceback
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from .description import PlantDescription, PlantError, Start


def check_description(description: PlantDescription) -> None:
    """Check that the tables of a description fit together; its functions are not called.

    Each name must be given once, and be a name that exists where it is referred to. There must be a
    state, an input, an output and a parameter, and all numbers must be within their limits.

    Raises:
        PlantError: they do not; the error lists all problems.
    """
    problems = [
        *_names(description),
        *_parameters(description),
        *_references(description),
        *_figures(description),
    ]
    if problems:
        raise PlantError([f"plant {description.name}: {problem}" for problem in problems])


def check_functions(description: PlantDescription, views: Any, par: Any) -> None:
    """Check that a description's functions, called as plain Python, return what they should.

    They are `rates`, `readings`, `per` of each equation and `value` of each region. They are called
    at the start values of the states (0 where a channel gives the start) and at these plus the
    spreads.

    Args:
        description: description whose tables fit together.
        views: named tuples of its states and inputs (`compiled_functions.Views`).
        par: named tuple of its parameters.

    Raises:
        PlantError: a function raises, returns no numbers or a wrong number of them, or returns a
            value that is not finite, which only `value` of a region may do; the error lists all
            problems.
    """
    inputs = views.inputs(*(0.5 * each.size for each in description.inputs))
    at_rest = description.at_rest
    nudged = [value + each.spread for value, each in zip(at_rest, description.states, strict=True)]
    problems: list[str] = []
    for values in (at_rest, nudged):
        state = views.state(*(float(value) for value in values))
        for kind, function, names in (
            ("rates", description.rates, [f"the rate of {s.name}" for s in description.states]),
            ("readings", description.readings, [o.channel for o in description.outputs]),
        ):
            plain = getattr(function, "py_func", function)
            problems += _called(kind, plain, (state, inputs, par), names)
        several = views.state(*(np.full(2, float(value)) for value in values))
        driven = views.inputs(*(np.full(2, value) for value in inputs))
        for region in description.regions:
            where = f"region {region.name!r}: value"
            problems += _array(where, region.value, (several, driven), finite=False)
        for equation in description.equations:
            where = f"equation {equation.name!r}: per"
            problems += _array(where, equation.per, (several, par), finite=True)
    if problems:
        raise PlantError([f"plant {description.name}: {each}" for each in dict.fromkeys(problems)])


def _called(
    kind: str, function: Any, arguments: tuple[Any, ...], names: list[str]
) -> Iterator[str]:
    try:
        found = function(*arguments)
    except Exception as error:
        yield f"{kind}: {_reason(error, arguments)}"
        return
    try:
        values = [float(each) for each in found]
    except (TypeError, ValueError):
        yield f"{kind}: returns {found!r}, must return a tuple of {len(names)}: {', '.join(names)}"
        return
    if len(values) != len(names):
        yield f"{kind}: returns {len(values)} values, must be {len(names)}: {', '.join(names)}"
        return
    state, inputs, _ = arguments
    for name, value in zip(names, values, strict=True):
        if not math.isfinite(value):
            yield (
                f"{kind}: {name} is {value} at {_listed(state)} and {_listed(inputs)}; it must be "
                "finite wherever the plant can be"
            )


def _reason(error: Exception, arguments: tuple[Any, ...]) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    where = f"{frames[-1].filename}:{frames[-1].lineno}: " if len(frames) > 1 else ""
    text = f"{where}{type(error).__name__}: {error}"
    if isinstance(error, AttributeError) and isinstance(error.name, str):
        known = [name for each in arguments for name in each._fields]
        near = get_close_matches(error.name, known, n=1)
        text += f"; did you mean {near[0]}?" if near else f"; there are {', '.join(known)}"
    return text


def _array(where: str, function: Any, arguments: tuple[Any, ...], finite: bool) -> Iterator[str]:
    """Yield in words what is wrong with a function that takes arrays (2,) of the states.

    Nothing is yielded if it returns numbers, one or two. If `finite`, they must be finite. `where`
    names the function in the words.
    """
    plain = getattr(function, "py_func", function)
    try:
        found = np.asarray(plain(*arguments), dtype=np.float64)
        is_finite = bool(np.all(np.isfinite(np.broadcast_to(found, (2,)))))
    except Exception as error:
        yield f"{where}: {type(error).__name__}: {error}"
        return
    if finite and not is_finite:
        yield f"{where} is {found}, must be finite"


def _listed(view: Any) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in view._asdict().items())


def _named(description: PlantDescription) -> dict[str, list[str]]:
    """Return the names of all parts of a description, by the kind of part."""
    return {
        "state": [each.name for each in description.states],
        "input": [each.channel for each in description.inputs],
        "output": [each.channel for each in description.outputs],
        "parameter": [each.name for each in description.parameters],
        "effect": [each.name for each in description.effects],
        "equation": [each.name for each in description.equations],
        "region": [each.name for each in description.regions],
    }


def _names(description: PlantDescription) -> Iterator[str]:
    kinds = _named(description)
    for kind, names in kinds.items():
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                yield f"{kind} {name} is given {names.count(name)} times; rename or delete one"
            named = kind in ("state", "input", "parameter")
            if named and (not name.isidentifier() or name.startswith("_")):
                yield f"{kind} {name!r} must be a Python name, as in position_m"
        if not names and kind not in ("effect", "region", "equation"):
            yield f"there is no {kind}; give at least one"
    if "time" in kinds["region"]:
        yield "region 'time' is there without being described; rename or delete it"
    varying = [each.name for each in description.may_vary]
    for name in dict.fromkeys(varying):
        if varying.count(name) + kinds["equation"].count(name) > 1:
            yield f"{name!r} is the name of several equations or varying parameters; rename one"


def _parameters(description: PlantDescription) -> Iterator[str]:
    for each in description.parameters:
        if not each.lower < each.upper:
            yield f"parameter {each.name}: lower {each.lower} must be below upper {each.upper}"
        elif each.neutral is not None and not each.lower <= each.neutral <= each.upper:
            yield (
                f"parameter {each.name}: neutral {each.neutral} must be within {each.lower} to "
                f"{each.upper}"
            )


def _references(description: PlantDescription) -> Iterator[str]:
    kinds = _named(description)
    parameters, outputs, regions = kinds["parameter"], kinds["output"], kinds["region"]
    places = [*kinds["equation"], *outputs, *kinds["input"]]
    entered = [*kinds["equation"], *(f"reading of {name}" for name in outputs),
               *(each.name for each in description.may_vary)]  # fmt: skip
    used: dict[str, str] = {}
    for effect in description.effects:
        of = f"effect {effect.name}"
        if not effect.parameters:
            yield f"{of} has no parameters; give at least one"
        yield from _unknown(f"{of}: parameter", effect.parameters.values(), parameters)
        for start in effect.starts:
            yield from _unknown(f"{of}: start", start, [*effect.parameters])
        yield from _unknown(f"{of}: where", [effect.where], places)
        first = next(iter(effect.parameters.values()), "")
        if first in used:
            yield f"effects {used[first]} and {effect.name} both change {first}; keep one"
        used[first] = effect.name
        for place, quantity in effect.own:
            yield from _unknown(f"{of}: own: place", [place], entered)
            yield from _unknown(f"{of}: own: region", [quantity], [*regions, "time"])
    yield from _unknown("tolerances:", description.tolerances, parameters)
    for varying in description.varying or ():
        of = f"varying {varying.name!r}"
        if not 1 <= len(varying.parameters) <= 2:
            yield f"{of} has {len(varying.parameters)} parameters; give 1 or 2"
        yield from _unknown(f"{of}: parameter", varying.parameters, parameters)
        yield from _unknown(f"{of}: region", varying.of, regions)
    if description.input_delay is not None:
        yield from _unknown("input_delay:", [description.input_delay], parameters)
    for equation in description.equations:
        yield from _unknown(f"equation {equation.name!r}: state", [equation.state], kinds["state"])
        yield from _unknown(f"equation {equation.name!r}: region", equation.of, regions)
    for state in description.states:
        if isinstance(state.start, Start):
            yield from _unknown(f"state {state.name}: start", [state.start.channel], outputs)
    for driven, seen in description.steering or {}:
        yield from _unknown("steering: input", [driven], kinds["input"])
        yield from _unknown("steering: output", [seen], outputs)


def _unknown(what: str, names: Iterable[str], known: Sequence[str]) -> Iterator[str]:
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            remedy = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
            yield f"{what} {name} is not known; {remedy}"


def _figures(description: PlantDescription) -> Iterator[str]:
    if description.substeps < 1:
        yield f"substeps {description.substeps} must be 1 or more"
    above, from_ = "above 0", "0 or above"
    rows = [(f"state {each.name}: spread", each.spread, above) for each in description.states]
    for output in description.outputs:
        rows.append((f"output {output.channel}: noise", output.noise, above))
        rows.append((f"output {output.channel}: resolution", output.resolution, from_))
    rows += [(f"input {each.channel}: size", each.size, above) for each in description.inputs]
    rows += [
        (f"tolerances: {name}", share, from_) for name, share in description.tolerances.items()
    ]
    for what, value, must in rows:
        if not (value > 0.0 or (value == 0.0 and must == from_)):
            yield f"{what} {value} must be {must}"
