"""The `drivers` of a rig file are read here: the type and the options of each of them."""

from contextlib import suppress
from typing import Annotated, Any, NamedTuple

from pydantic import create_model

from rig.configuration.reading import Is, Located, Schema, options_schema, read_options, suggestion
from rig.io import DriverError, DriverSpec, driver_class, driver_types


def driver_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of all installed drivers, each with the type of its driver."""
    files = []
    for kind in driver_types():
        with suppress(DriverError):
            keys = options_schema(driver_class(kind).Options)
            name = f"{kind}_driver"
            files.append(
                create_model(
                    name,
                    __base__=keys,
                    __doc__=f"Keys of {kind}.",
                    driver=(Annotated[Any, Is(kind)], ...),
                )
            )
    return tuple(files)


class PlacedDriver(NamedTuple):
    """A driver, and the section of a rig file that describes it."""

    spec: DriverSpec
    item: Located


def read_drivers(item: Located) -> tuple[PlacedDriver, ...] | None:
    """Return the drivers of a rig file; if any is unusable, record the problems and return None.

    `item` is the section `drivers`.
    """
    if not isinstance(item.value, dict):
        item.refuse("is not a mapping", "write `name: {driver: ..., ...}` for each")
        return None
    specs = [(_read_driver(name, section), section) for name, section in item.items()]
    drivers = tuple(PlacedDriver(spec, section) for spec, section in specs if spec is not None)
    return drivers if len(drivers) == len(specs) else None


def _read_driver(name: str, section: Located) -> DriverSpec | None:
    entry = section.get("driver")
    if entry is None:
        remedy = f"add `driver: ...`, one of {', '.join(driver_types())}"
        section.refuse("lacks the key driver", remedy, "")
        return None
    driver_type = str(entry.value)
    if driver_type not in driver_types():
        remedy = suggestion(driver_type, driver_types(), "drivers")
        entry.refuse("is not a known driver", remedy, driver_type)
        return None
    refused = entry
    try:
        options_class = driver_class(driver_type).Options
        refused = section
        keys = {key: value for key, value in section.items() if key != "driver"}
        options = read_options(options_class, section.with_value(keys))
        return None if options is None else DriverSpec.of(name, driver_type, options)
    except DriverError as error:
        # A driver names the option that is wrong, if one is.
        option = refused.get(error.channel)
        channel = "" if option is not None else error.channel
        (option or refused).refuse(error.state, error.action, channel)
        return None
