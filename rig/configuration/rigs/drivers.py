"""The `drivers` of a rig file are read here: the type and the options of each of them."""

from collections.abc import Iterator
from typing import NamedTuple

from rig.configuration.reading import Located, Problems, Sources, read_options, shown, suggestion
from rig.io import DriverError, DriverSpec, driver_class, driver_types


class PlacedDriver(NamedTuple):
    """A driver, and the section of a rig file that describes it."""

    spec: DriverSpec
    item: Located


def read_drivers(item: Located | None, sources: Sources) -> tuple[PlacedDriver, ...] | None:
    """Return the drivers of a rig file; if any is unusable, record the problems and return None.

    `item` is the section `drivers`; without it there are no drivers.
    """
    if item is None:
        return ()
    if not isinstance(item.value, dict):
        remedy = "write `name: {driver: ..., ...}` for each"
        sources.problems.add(item.place, item.name, shown(item), "is not a mapping", remedy)
        return None
    before = sources.problems.reported
    drivers = tuple(_read_drivers(item, sources))
    return drivers if sources.problems.reported == before else None


def _read_drivers(item: Located, sources: Sources) -> Iterator[PlacedDriver]:
    for name, section in item.items():
        entry = section.get("driver")
        if entry is None:
            remedy = f"add `driver: ...`, one of {', '.join(driver_types())}"
            sources.problems.add(section.place, name, "", "lacks the key driver", remedy)
            continue
        spec = _read_driver(name, section, entry, sources)
        if spec is not None:
            yield PlacedDriver(spec, section)


def _read_driver(
    name: str, section: Located, entry: Located, sources: Sources
) -> DriverSpec | None:
    driver_type, problems = str(entry.value), sources.problems
    if driver_type not in driver_types():
        remedy = suggestion(driver_type, driver_types(), "drivers")
        problems.add(entry.place, "driver", driver_type, "is not a known driver", remedy)
        return None
    try:
        options_class = driver_class(driver_type).Options
    except DriverError as error:
        _add(error, entry, "driver", problems)
        return None
    keys = {key: value for key, value in section.items() if key != "driver"}
    try:
        options = read_options(options_class, Located(keys, section.place, name), sources)
        return None if options is None else DriverSpec.of(name, driver_type, options)
    except DriverError as error:
        _add(error, section, name, problems)
        return None


def _add(error: DriverError, item: Located, name: str, problems: Problems) -> None:
    """Record a driver's error as a problem of the option that it names, else of the driver."""
    option = item.get(error.channel)
    if option is not None:
        problems.add(option.place, error.channel, "", error.state, error.action)
    else:
        problems.add(item.place, name, error.channel, error.state, error.action)
