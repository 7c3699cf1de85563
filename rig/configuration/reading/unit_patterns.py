"""Patterns of texts that are quantities, for editors: a number, and a unit that suits."""

import re
from typing import Final

from .quantities import DIMENSIONS, dimension

_ALSO_READ: Final[dict[str, tuple[str, ...]]] = {
    "m": ("cm", "dm", "km", "µm", "nm", "inch", "thou", "ft"),
    "m^2": ("dm^2", "um^2"),
    "m^3": ("mL", "ml", "l", "dm^3", "mm^3", "gal"),
    "m/s": ("cm/s", "m/min", "mm/min", "km/h", "ft/s"),
    "m^2/m": ("cm^2/cm", "in^2/in", "m", "mm", "um"),
    "kg": ("mg", "lb"),
    "kg/m^3": ("kg/L", "g/L", "g/mL"),
    "s": ("us", "µs", "ns", "h", "d", "hour", "hours", "day", "days", "minutes", "seconds"),
    "rad": ("mrad", "°", "turn"),
    "rad/s": ("deg/s", "mrad/s", "rpm", "mHz", "kHz"),
    "Hz": ("MHz",),
    "V": ("kV", "uV", "µV"),
    "m/V": ("cm/V", "nm/V", "µm/V", "in/V"),
    "V s/m": (
        "V*s/m", "V s/mm", "V*s/mm", "mV s/mm", "V/(m/s)", "V/(mm/s)", "V s/in", "V/(in/s)",
    ),
    "V/m": ("V/cm", "mV/mm", "V/um", "V/in"),
    "Pa": ("hPa", "GPa", "mbar", "N/mm^2", "N/m^2", "atm", "ksi"),
    "N": ("mN", "MN", "lbf"),
    "N/m": ("N/um", "kN/mm", "MN/m", "N/cm", "lbf/in"),
    "N s/m": (
        "N*s/m", "N s/mm", "N*s/mm", "kN s/mm", "N/(m/s)", "N/(mm/s)", "lbf s/in",
    ),
    "m^3/s": (
        "L/s", "l/s", "mL/s", "l/min", "ml/min", "L/h", "m^3/min", "m^3/h", "cm^3/s", "cm^3/min",
        "gal/min", "in^3/s", "in^3/min",
    ),
    "m^3/(s Pa^0.5)": (
        "m^3/s/Pa^0.5", "L/(min bar^0.5)", "L/min/bar^0.5", "m^3/(s sqrt(Pa))", "gpm/psi^0.5",
    ),
    "m^3/(s Pa)": ("m^3/s/Pa", "L/(min bar)", "L/min/bar", "gpm/psi"),
}  # fmt: skip
"""SI unit -> further units that are read and that an editor takes, beside the usual ones. More are
read, as any unit of the right dimension is; a file with such a one is sound, but marked."""
_DIGITS: Final = r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?"


def known_units(si_unit: str) -> tuple[str, ...]:
    """Return the units that an editor takes for a quantity, the usual ones first."""
    return (*dimension(si_unit).units, *_ALSO_READ.get(si_unit, ()))


def quantity_pattern(si_unit: str, *, signed: bool = True) -> str:
    """Return the regular expression of a text that gives a quantity, as JSON schema has it.

    Args:
        si_unit: SI unit of the quantity; the unit may be left out if it is "" or "rad".
        signed: whether the quantity may be negative.
    """
    return _pattern(known_units(si_unit), signed, bare=si_unit in ("", "rad"))


def any_quantity_pattern() -> str:
    """Return the pattern of a text that gives a quantity of whatever kind."""
    units = dict.fromkeys(unit for each in (*DIMENSIONS, "K") for unit in known_units(each))
    return _pattern(tuple(units), signed=True, bare=True)


def _pattern(units: tuple[str, ...], signed: bool, *, bare: bool) -> str:
    sign = "[+-]?" if signed else r"\+?"
    choices = "|".join(re.escape(unit).replace(r"\ ", " ") for unit in units if unit)
    unit = rf"\s*({choices})" if choices else ""
    return rf"^\s*{sign}{_DIGITS}{f'({unit})?' if bare and unit else unit}\s*$"
