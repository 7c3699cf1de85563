"""How far a ram must move before its rig may be called healthy."""

from estimator.accounts import reference_drop
from rig.plant import Parameters


def travel_needed(par: Parameters) -> float:
    """Return the travel in m that a ram must make before its rig may be called healthy.

    It sweeps as much oil as a chamber stores by compression at half the supply pressure, V/beta dp:
    the volume V is that of chamber 1 and its line at mid stroke (eq. 2.4). With less motion a leak
    can empty its chamber and then no longer shows.
    """
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    volume = par.line_volume_1 + par.piston_area * (middle - par.stroke_min)
    stored = volume / par.bulk_modulus * reference_drop(par, "external_leakage_1")
    return float(stored / par.piston_area)
