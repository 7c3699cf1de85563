"""Finds the class of a driver by its type, which names an entry point of `hydraulic_rig.drivers`.

A driver's module is imported only when a rig asks for it. So the client libraries of other drivers
take no time, and a third party's driver that cannot be imported does not disturb the others.
"""

from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final, Literal

from rig.compile_cache import DRIVERS

from .driver import Driver, DriverError, FastDriver, Plan

_REQUIRED: Final = ("kind", "Options", "open", "read", "write", "safe_state", "close")
_REQUIRED_OF_FAST: Final = ("fileno", "plan", "look_plan", "driven")


@dataclass(frozen=True)
class DriverSpec:
    """A driver as a rig file configures it, with the properties that it has before it is opened.

    Attributes:
        name: name of the driver in the rig file.
        type: name of the driver's entry point.
        path: place of the driver's class, as `module:class`.
        options: an instance of that class's `Options`.
        kind: "fast" or "slow".
        inputs: signals that the driver reads.
        outputs: signals that the driver writes.
        rate_hz: greatest rate in Hz at which the driver can be read and written.
    """

    name: str
    type: str
    path: str
    options: Any
    kind: Literal["fast", "slow"]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rate_hz: float

    @classmethod
    def of(cls, name: str, driver_type: str, options: Any) -> "DriverSpec":
        """Return the specification of a driver; an instance is made for it, and is not opened.

        Raises:
            DriverError: no driver of this type is installed, several are, it is broken, or it
                refuses its options.
        """
        entry, driver = _entry_point(driver_type), driver_class(driver_type)(name, options)
        for way in ("plan", "look_plan") if driver.kind == "fast" else ():
            plan = getattr(driver, way)()
            if not (isinstance(plan, tuple) and isinstance(plan, Plan)):
                made = f"a {type(plan).__name__}, no NamedTuple with an exchange"
                raise _broken(entry, f"returns by {way}() {made}")
        says = driver.kind, driver.inputs, driver.outputs, driver.rate_hz
        return cls(name, driver_type, entry.value, options, *says)

    def create(self) -> Driver:
        """Return the driver, not yet open.

        Raises:
            DriverError: the driver is not installed or is broken, or refuses its options.
        """
        driver: Driver = driver_class(self.type)(self.name, self.options)
        return driver

    def create_fast(self) -> FastDriver:
        """Return the fast driver, not yet open, with which the loop is to exchange samples.

        Raises:
            DriverError: the driver is not installed or is broken, refuses its options, or is not a
                fast one.
        """
        driver = self.create()
        if not isinstance(driver, FastDriver):
            raise DriverError(self.name, f"{self.path} is not a fast driver", "name one that is")
        return driver


def driver_types() -> tuple[str, ...]:
    """Return the names of all types of drivers that are installed, sorted."""
    return tuple(sorted(_installed()))


def driver_class(driver_type: str) -> Any:
    """Return the class of a type of driver; check that it has all names that a driver must have.

    Raises:
        DriverError: no driver of this type is installed, several are, or the driver is broken; the
            message names the packages.
    """
    entry = _entry_point(driver_type)
    try:
        found = entry.load()
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise _broken(entry, f"cannot be imported: {reason}") from error
    lacking = [name for name in _REQUIRED if not hasattr(found, name)]
    if lacking or not is_dataclass(found.Options):
        what = ", ".join(lacking) if lacking else "a dataclass Options"
        raise _broken(entry, f"is not a driver: it lacks {what}")
    lacking = [name for name in _REQUIRED_OF_FAST if not hasattr(found, name)]
    if found.kind == "fast" and lacking:
        raise _broken(entry, f"is not a fast driver: it lacks {', '.join(lacking)}")
    return found


def _entry_point(driver_type: str) -> EntryPoint:
    found = _installed().get(driver_type)
    if found is None:
        listing = ", ".join(driver_types())
        raise DriverError(driver_type, "is not a known driver", f"choose one of {listing}")
    if len(found) > 1:
        owners = " and ".join(sorted(_owner(entry) for entry in found.values()))
        raise DriverError(driver_type, f"is a driver of {owners}", "uninstall all but one of them")
    return next(iter(found.values()))


@cache
def _installed() -> Mapping[str, Mapping[str, EntryPoint]]:
    """Return the entry points by type of driver and then by `module:class`.

    An entry point that is found twice counts once. They are looked up once in a process, because a
    rig file needs them dozens of times, and each look-up reads a file of every installed package.
    """
    installed: dict[str, dict[str, EntryPoint]] = {}
    for entry in entry_points(group=DRIVERS):
        installed.setdefault(entry.name, {})[entry.value] = entry
    return installed


def _owner(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value


def _broken(entry: EntryPoint, state: str) -> DriverError:
    action = f"repair or uninstall the package {_owner(entry)}"
    return DriverError(entry.name, f"{entry.value} {state}", action)
