"""Sections of a file are read here into a dataclass of a lower layer, by the types of its fields.

The options of a driver, register maps, the settings of the loop and of homing, and the transducers'
data sheet are such sections. Only the class says which keys may be written, in which unit and
within which limits.
"""

from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from pydantic import Field as SchemaField, create_model

from rig.io import RegisterMapError
from rig.plant import Quantity

from .document import Located
from .fields import Physical
from .lookup import FOLDERS, reference_in, resolve
from .validation import Schema, Under, elements_of, read_mapping

T = TypeVar("T")


class Option(NamedTuple):
    """A field of a class of options.

    Attributes:
        hint: type of the field.
        quantity: unit and limits of the field; None if it has none.
        default: default of the field; `...` if it has none.
    """

    hint: Any
    quantity: Quantity | None
    default: Any


def read_options(options: type[T], item: Located | None) -> T | None:
    """Return an object of the class `options`, made from a mapping with the class's fields as keys.

    If it cannot be made, record the problems and return None. If `item` is None, all fields have
    their defaults. The class is a dataclass or a named tuple.
    """
    if item is None:
        return options()
    problems = item.sources.problems
    before = problems.reported
    known = options_of(options)
    kind: type = options
    file = read_mapping(options_schema(kind), item)
    # model_dump is not used here, as it would turn dataclasses into dicts.
    values = {key: getattr(file, key) for key in known} if file is not None else {}
    for name, option in known.items():
        entry, reader = item.get(name), _reader(option)
        if reader is not None and entry is not None:
            values[name] = reader(entry)
    if problems.reported > before:
        return None
    try:
        return options(**values)
    except RegisterMapError as error:
        for problem in error.problems:
            item.find(*problem.path).refuse(problem.limit, problem.remedy, problem.value)
    except ValueError as error:
        item.refuse(f"cannot be used: {error}", value="")
    return None


@cache
def options_schema(options: type) -> type[Schema]:
    """Return the class of the keys by which an object of the class `options` is written."""
    definitions: Any = {
        name: (_written(each), each.default) for name, each in options_of(options).items()
    }
    return create_model(
        f"{options.__name__}File", __base__=Schema, __doc__=options.__doc__, **definitions
    )


def options_of(options: type) -> dict[str, Option]:
    """Return name -> `Option` of the fields of a dataclass or named tuple, in their order.

    Fields that the class's constructor does not take are left out.
    """
    hints = get_type_hints(options, include_extras=True)
    if is_dataclass(options):
        usual = {f.name: _default(f) for f in fields(options) if f.init}
    else:
        given = getattr(options, "_field_defaults", {})
        usual = {name: given.get(name, ...) for name in hints}
    return {name: _option(hints[name], default) for name, default in usual.items()}


def _default(field: Field[Any]) -> Any:
    """Return a field's default; `...` if it has none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return ... if field.default is MISSING else field.default


def _option(hint: Any, default: Any) -> Option:
    quantity = None
    if get_origin(hint) is Annotated:
        hint, *extras = get_args(hint)
        quantity = next((extra for extra in extras if isinstance(extra, Quantity)), None)
    return Option(hint, quantity, default)


def kind_of(option: Option) -> Any:
    """Return the type of an option's value, which is T for an option of type `T | None`."""
    kinds = get_args(option.hint)
    if len(kinds) == 2 and type(None) in kinds:
        return next(kind for kind in kinds if kind is not type(None))
    return option.hint


def _written(option: Option) -> Any:
    """Return the type by which a schema checks an option, with its unit and limits.

    It is Any for an option that a function of its own reads (`_reader`).
    """
    kind, quantity = kind_of(option), option.quantity
    if _reader(option) is not None:
        return _section_written(kind)
    if quantity is None:
        return option.hint
    if kind is int:
        return Annotated[option.hint, SchemaField(ge=quantity.lower, le=quantity.upper)]
    usual = option.default if isinstance(option.default, float) and option.default else None
    limits = Physical(quantity.unit, quantity.lower, quantity.upper, usual)
    return Annotated[option.hint, limits]


def _section_written(kind: Any) -> Any:
    """Return Any, with what an editor may know of a section, a list of sections, or a path."""
    if _is_section(kind):
        return Annotated[Any, Under(lambda: (options_schema(kind),), text=True)]
    element: Any = get_args(kind)[0] if get_origin(kind) is tuple else None
    if _is_section(element):
        return Annotated[Any, Under(lambda: (options_schema(element),), many=True)]
    return Any


def _reader(option: Option) -> Callable[[Located], Any] | None:
    """Return the function that reads an option; None if the option is a plain value of YAML.

    Paths, nested sections and lists of sections have such a function.
    """
    kind = kind_of(option)
    if kind is Path:
        return _read_path
    if _is_section(kind):
        return partial(_read_section, kind)
    element: Any = get_args(kind)[0] if get_origin(kind) is tuple else None
    if _is_section(element):
        return partial(_read_list, element)
    return None


def _is_section(kind: Any) -> bool:
    return isinstance(kind, type) and is_dataclass(kind)


def _read_path(item: Located) -> Path | None:
    """Return the path that an option gives, resolved from the folder of the file that gives it.

    If it is no text, add a problem and return None. The path need not exist, unless the option is
    named after a kind of configuration (`dbc`): such an option may give a name too, and if there is
    no such file, a problem is added and the result is None.
    """
    reference = reference_in(item)
    if reference is None:
        item.refuse("is not a path", "write one")
        return None
    return resolve(item.name, item) if item.name in FOLDERS else item.path_to(reference)


def _read_section(kind: type[T], item: Located) -> T | None:
    """Return a nested section, written in place or in a map file that is given by path or name.

    If it cannot be used, record the problems and return None.
    """
    if reference_in(item) is None:
        return read_options(kind, item)
    root = item.sources.read_yaml(resolve("map", item), item)
    return read_options(kind, root) if root is not None else None


def _read_list(kind: type[T], item: Located) -> tuple[T | None, ...]:
    return tuple(read_options(kind, each) for each in elements_of(item, "write a list: - {...}"))
