"""How far a ram must move before its rig may be called healthy."""

from estimator.accounts import reference_drop
from rig.plant import Parameters, chamber_volumes


def travel_needed(par: Parameters) -> float:
    """Return the travel in m that a ram must make before its rig may be called healthy.

    It sweeps as much oil as a chamber stores by compression at half the supply pressure, V/beta dp:
    the volume V is that of chamber 1 and its line at mid stroke. With less motion a leak can empty
    its chamber and then no longer shows.
    """
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    # Campaign files are checked with this before anything runs: plain Python, as one value is not
    # worth the time for loading compiled code.
    volumes = getattr(chamber_volumes, "py_func", chamber_volumes)
    volume = volumes(middle, par)[0]
    stored = volume / par.bulk_modulus * reference_drop(par, "external_leakage_1")
    return float(stored / par.piston_area)
