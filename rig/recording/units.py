"""A channel's name carries its unit as a suffix (`pressure_1_Pa`)."""

from typing import Final

UNITS: Final = {
    **{unit: unit for unit in ("s", "Hz", "V", "A", "W", "m", "kg", "N", "Pa", "degC", "K")},
    "m_per_s": "m/s",
    "m_per_s2": "m/s^2",
    "rad_per_s": "rad/s",
    "m2": "m^2",
    "m3": "m^3",
    "N_per_m": "N/m",
    "N_s_per_m": "N s/m",
    "Pa2": "Pa^2",
    "Pa_per_s": "Pa/s",
    "m3_per_s": "m^3/s",
    "L_per_min": "L/min",
    "m3_per_s_sqrtPa": "m^3/(s sqrt(Pa))",
    "m3_per_s_Pa": "m^3/(s Pa)",
}
"""Suffix of a channel name (without the leading underscore) -> unit as printed."""

CONVERSIONS: Final = {
    "bar": ("Pa", "1e5"),
    "MPa": ("Pa", "1e6"),
    "kPa": ("Pa", "1e3"),
    "psi": ("Pa", "6894.757"),
    "mm": ("m", "1e-3"),
    "cm": ("m", "1e-2"),
    "um": ("m", "1e-6"),
    "in": ("m", "0.0254"),
    "ms": ("s", "1e-3"),
    "us": ("s", "1e-6"),
    "ns": ("s", "1e-9"),
    "mV": ("V", "1e-3"),
}
"""Suffix of another unit -> (SI suffix, factor to SI), for remedies in error messages."""


def unit_of(channel: str) -> str:
    """Return the unit that a channel's suffix names (`flow_1_m3_per_s` -> `m^3/s`); "" if none."""
    parts = channel.split("_")
    # The longest suffix counts, so `speed_m_per_s` is in m/s, not in seconds.
    for start in range(1, len(parts)):
        unit = UNITS.get("_".join(parts[start:]))
        if unit is not None:
            return unit
    return ""
