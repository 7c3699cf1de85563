"""Opens the drivers of a rig one after the other and closes them again: nothing moves."""

from collections.abc import Iterator

from rig.io import DriverError, DriverSpec, exclusive

from .machine import Finding


def probe(drivers: tuple[DriverSpec, ...]) -> Iterator[Finding]:
    """Yield what becomes of opening each driver: the device answered and is the one expected."""
    for spec in drivers:
        yield _probe(spec)


def _probe(spec: DriverSpec) -> Finding:
    subject = f"driver {spec.name}"
    try:
        driver = spec.create()
        try:
            with exclusive([spec]):
                driver.open()
        finally:
            driver.close()
    except DriverError as error:
        found = f"{error.channel}: {error.state}" if error.channel else error.state
        return Finding(subject, found, "bad", error.action)
    return Finding(subject, f"{spec.type} answers, {spec.kind}, {spec.rate_hz:g} Hz")
