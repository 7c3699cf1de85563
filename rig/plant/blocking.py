"""Blocking valves between servovalve and chambers, as a change of the servovalve's parameters.

A blocking valve stands in the line of one chamber. Its orifice and the servovalve's open edge are
in series, so that the flow through both is that of the edge times a share. The compiled plant need
not know of it: the shares are put into the discharge coefficient and the difference of the ports.
"""

from math import hypot, inf, sqrt
from typing import Final

from .dynamics import valve_conductance
from .parameters import Parameters

OPEN_CONDUCTANCE: Final = inf
"""Conductance of an open blocking valve, m^3/(s Pa^0.5): its drop is neglected."""


def leak_conductance(flow: float, pressure: float) -> float:
    """Return the conductance in m^3/(s Pa^0.5) of a shut valve by its data sheet.

    Args:
        flow: greatest leak, m^3/s.
        pressure: pressure difference at which that leak is stated, Pa.
    """
    return flow / sqrt(pressure)


def throttled(par: Parameters, opening: float, conductances: tuple[float, float]) -> Parameters:
    """Return the parameters of a servovalve that works through two blocking valves.

    Two turbulent orifices of conductances C (edge) and k (blocking valve) in series pass the flow
    of 1 / sqrt(1/C^2 + 1/k^2), which is the edge's times k / sqrt(C^2 + k^2) (Merritt 1967, ch. 3).
    With an underlap, which has two edges open at a time, this is an approximation.

    Args:
        par: parameters of the rig. With both valves open they are returned unchanged.
        opening: the spool's position plus its null bias, m.
        conductances: conductance of the valve of chamber 1 and of chamber 2, m^3/(s Pa^0.5), both
            above zero; `OPEN_CONDUCTANCE` for an open valve.
    """
    if conductances == (OPEN_CONDUCTANCE, OPEN_CONDUCTANCE):
        return par
    edge = valve_conductance(par) * (abs(opening) + par.valve_underlap_leakage)
    first, second = (1.0 if k == OPEN_CONDUCTANCE else k / hypot(edge, k) for k in conductances)
    return par._replace(
        discharge_coefficient=par.discharge_coefficient * first,
        valve_flow_asymmetry=1.0 - (1.0 - par.valve_flow_asymmetry) * second / first,
    )
