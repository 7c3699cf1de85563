"""Other formulas of the effects on the menu, as the literature has them, each with its source.

The gap workflow's catalogue has one formula for each effect, but a real rig follows none exactly. A
form takes the values of a rig in which `menu.MENU` has hidden an effect, and returns those of a rig
with the same effect by another formula. The two agree at one point: the pressure at rest, an
opening of 0.1 mm, a speed of 0.1 m/s, a flow of 18 L/min, or a pressure drop of 2 MPa.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import sqrt
from typing import Final

from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.hidden_effects.sizes import Sizes, even, up

Parameters = Mapping[str, float]
Shape = Callable[[RigValues, Parameters], RigValues]

CATALOGUE: Final = "catalogue"
"""Name of the form that the catalogue has."""

_DROP: Final = 2e6
"""Pa: pressure drop at which leaks of all forms are equal."""
_REST: Final = 6.9e6
"""Pa: chamber pressure at rest."""
_TRAVEL: Final = 0.3
"""m: position at which encoders of all forms read the same."""


@dataclass(frozen=True)
class Form:
    """Another formula of an effect.

    Attributes:
        shape: changes the rig's values from the catalogue's formula to this one.
        sizes: distributions of those parameters that the catalogue's formula has not, SI.
    """

    shape: Shape
    sizes: Mapping[str, Sizes] = field(default_factory=dict)


# The valve.


def _rounded_overlap(rig: RigValues, effect: Parameters) -> RigValues:
    """Overlap with rounded edges (Shearer 1980, on radial clearance and rounded edges).

    y + [sqrt((y - d)^2 + c^2) - sqrt((y + d)^2 + c^2)] / 2, with c a share of the overlap d.
    """
    return rig._replace(round_overlap=effect["rounding"] * rig.overlap)


def _uneven_overlap(rig: RigValues, effect: Parameters) -> RigValues:
    """Overlap that is smaller on the side of negative openings (Tao and Kokotovic 1996, ch. 2)."""
    return rig._replace(uneven_overlap=effect["uneven"])


def _soft_underlap(rig: RigValues, effect: Parameters) -> RigValues:
    """Underlap that fades: max(0, y) + u exp(-|y|/u), near Eryilmaz and Wilson 2000.

    They join leakage and orifice flow by a leak that fades with the opening, as a rational term;
    here it is an exponential.
    """
    return rig._replace(underlap=0.0, soft_underlap=rig.underlap)


def _round_underlap(rig: RigValues, effect: Parameters) -> RigValues:
    """Edges with a radial clearance c: an opening of sqrt(x^2 + c^2) (Merritt 1967, ch. 5)."""
    return rig._replace(underlap=0.0, round_underlap=rig.underlap)


def _loss_that_comes_up(rig: RigValues, effect: Parameters) -> RigValues:
    """Port 2 loses more, the wider it is open: a flow gain that falls (Jelali and Kroll 2003)."""
    return rig._replace(port_2_reach=effect["reach"])


def _loss_to_tank(rig: RigValues, effect: Parameters) -> RigValues:
    """Only one of the four edges differs from the others (Merritt 1967, ch. 5)."""
    return rig._replace(port_2_tank_only=1.0)


def _smooth_hysteresis(rig: RigValues, effect: Parameters) -> RigValues:
    """Hysteresis as a smooth loop (Bouc 1967; Wen 1976), as of a torque motor's magnet."""
    half = rig.spool_play
    return rig._replace(spool_play=0.0, spool_loop=half, spool_loop_reach=effect["reach"] * half)


def _first_order_spool(rig: RigValues, effect: Parameters) -> RigValues:
    """A lag of first order, 1/omega, and a delay of 0.4/omega (Thayer 1958, transfer functions).

    Their sum is the time 2 d/omega by which the catalogue's spool is late in slow motions.
    """
    late = (2.0 * rig.spool_damping - 1.0) / rig.spool_frequency
    return rig._replace(spool_order=1.0, dead_time=rig.dead_time + late)


def _soft_rate_limit(rig: RigValues, effect: Parameters) -> RigValues:
    """The spool's speed nears its limit as a hyperbolic tangent (Jelali and Kroll 2003, ch. 4)."""
    return rig._replace(spool_soft_speed=rig.spool_speed, spool_speed=1e9)


def _slower_hold(rig: RigValues, effect: Parameters) -> RigValues:
    """Commands pass at a slower rate and are held (Åström and Wittenmark 1997, ch. 3).

    They are late by `value` on average.
    """
    return rig._replace(dead_time=0.0, hold_ticks=round(2.0 * rig.dead_time / 1e-3) + 1.0)


# Oil and lines.


def _polytropic_air(rig: RigValues, effect: Parameters) -> RigValues:
    """Bubbles that change their temperature, p V^n = constant (Yu, Chen and Lu 1994)."""
    return rig._replace(air_exponent=effect["exponent"])


def _dissolving_air(rig: RigValues, effect: Parameters) -> RigValues:
    """Air that dissolves in proportion to the pressure (Henry 1803), until all of it is gone."""
    return rig._replace(air_gone=effect["gone"])


def _stiffening_oil(rig: RigValues, effect: Parameters) -> RigValues:
    """Stiffness that grows as log10(90 p/28 MPa + 3) (Lee 1977; Jelali and Kroll 2003)."""
    return rig._replace(stiffening=1.0)


def _droop(exponent: float) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """Pressure lost by another power of the flow.

        It is 1 in laminar flow (Hagen 1839, Poiseuille 1846), 1.75 in smooth pipes (Blasius 1913).
        """
        return rig._replace(droop_exponent=exponent)

    return shape


def _rise(exponent: float) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """Pressure that rises by another power of the flow (Hagen 1839; Blasius 1913)."""
        return rig._replace(rise_exponent=exponent)

    return shape


def _rectified_ripple(rig: RigValues, effect: Parameters) -> RigValues:
    """A rectified sine: one hump for each piston (Ivantysyn and Ivantysynova 2001)."""
    return rig._replace(ripple_rectified=1.0)


# Friction.


def _stribeck(exponent: float) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """Stribeck's curve as exp(-(v/vs)^n).

        n is 0.5 to 1 for Bo and Pavelescu 1982, and 2 for Armstrong-Hélouvry 1991.
        """
        return rig._replace(stribeck_exponent=exponent)

    return shape


def _hess_soom(rig: RigValues, effect: Parameters) -> RigValues:
    """Stribeck's curve as 1/(1 + (v/vs)^2) (Hess and Soom 1990)."""
    return rig._replace(hess_soom=1.0)


def _level_by_pressure(rig: RigValues, effect: Parameters) -> RigValues:
    """Friction that grows with the pressure across the piston (Bonchis, Corke and Rye 1999).

    Both levels are those of the catalogue at a pressure difference of 2 MPa.
    """
    return rig._replace(level_by_pressure=effect["share"] * (rig.sliding - TABLE.sliding) / _DROP)


def _direction_drag(rig: RigValues, effect: Parameters) -> RigValues:
    """Half of the asymmetry is one of the viscous friction (Armstrong-Hélouvry 1991)."""
    half = 0.5 * rig.direction_friction
    return rig._replace(direction_friction=half, direction_drag=half / 0.1)


def _power_drag(rig: RigValues, effect: Parameters) -> RigValues:
    """Viscous friction as |v|^0.7 sgn v (Olsson et al. 1998: an exponent that geometry chooses)."""
    return rig._replace(drag_exponent=0.7)


def _dahl(rig: RigValues, effect: Parameters) -> RigValues:
    """Seals that bend as dz/dt = v |1 - s0 z sgn(v)/g|^i, without damping (Dahl 1968)."""
    return rig._replace(dahl_exponent=effect["exponent"], seal_damping=0.0)


def _bouc_wen(rig: RigValues, effect: Parameters) -> RigValues:
    """Seals that bend by the law of Bouc 1967 and Wen 1976, with beta + gamma = 1."""
    return rig._replace(bouc_exponent=effect["exponent"], bouc_share=effect["share"])


def _damping_by_speed(rig: RigValues, effect: Parameters) -> RigValues:
    """Damping of the seals that fades at another speed (Olsson 1996, ch. 3)."""
    return rig._replace(seal_damping_speed=effect["damping_speed"])


def _steady_damping(rig: RigValues, effect: Parameters) -> RigValues:
    """Damping of the seals that does not fade (Canudas de Wit et al. 1995, as first published)."""
    return rig._replace(seal_damping_speed=1e9)


# Leaks.


def _laminar(leak: str) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """A leak in proportion to the pressure, as through a long gap (Merritt 1967, ch. 3)."""
        linear = effect["value"] / sqrt(_DROP)
        return rig._replace(**{leak: 0.0, f"{leak}_linear": linear})

    return shape


def _transition(leak: str) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """A leak that is laminar at first, and then turbulent (Borutzky, Barnard and Thoma 2002).

        q = k d / sqrt(|d| + p_t); k makes it the catalogue's at a drop d of 2 MPa.
        """
        value = effect["value"] * sqrt((_DROP + effect["transition"]) / _DROP)
        return rig._replace(**{leak: value, "leak_transition": effect["transition"]})

    return shape


# Environment and transducers.


def _hardening_spring(rig: RigValues, effect: Parameters) -> RigValues:
    """A spring with K d [1 + (d/h)^2] (Duffing 1918)."""
    return rig._replace(spring_hardening=effect["hardening"])


def _hertz_stop(rig: RigValues, effect: Parameters) -> RigValues:
    """A stop whose force grows with depth^1.5 (Hertz 1881; Lankarani and Nikravesh 1990)."""
    return rig._replace(stop_exponent=1.5)


def _kelvin_voigt_stop(rig: RigValues, effect: Parameters) -> RigValues:
    """A stop of a spring beside a linear damper (Goldsmith 1960)."""
    return rig._replace(stop_damping=effect["damping"])


def _curved_gauge(chamber: int) -> Shape:
    def shape(rig: RigValues, effect: Parameters) -> RigValues:
        """A transducer whose span is curved: p + c p^2 (Doebelin 1990, ch. 3: nonlinearity).

        It reads what the catalogue's does at the pressure at rest.
        """
        curve = (effect["value"] - 1.0) / _REST
        return rig._replace(**{f"gauge_{chamber}_gain": 1.0, f"gauge_{chamber}_curve": curve})

    return shape


def _curved_encoder(rig: RigValues, effect: Parameters) -> RigValues:
    """An encoder whose scale is curved: x + c x^2 (Doebelin 1990, ch. 3: nonlinearity)."""
    return rig._replace(encoder_gain=1.0, encoder_curve=(effect["value"] - 1.0) / _TRAVEL)


def _ringing_gauges(rig: RigValues, effect: Parameters) -> RigValues:
    """Gauges of second order with the same delay in slow motions (Doebelin 1990: tubing)."""
    return rig._replace(gauge_damping=effect["damping"])


def _filtered_encoder(rig: RigValues, effect: Parameters) -> RigValues:
    """A filter of first order, as late in slow motions (Doebelin 1990, ch. 3)."""
    return rig._replace(encoder_delay=0.0, encoder_lag=rig.encoder_delay)


def _soft_backlash(rig: RigValues, effect: Parameters) -> RigValues:
    """Play with soft contact (Nordin and Gutman 2002), as a loop of Bouc 1967 and Wen 1976."""
    half = 0.5 * rig.encoder_play
    return rig._replace(
        encoder_play=0.0, encoder_loop=half, encoder_loop_reach=effect["reach"] * half
    )


_STRIBECK: Final = {
    "exponent 0.5": Form(_stribeck(0.5)),
    "exponent 2": Form(_stribeck(2.0)),
    "Hess-Soom": Form(_hess_soom),
}


def _leak_forms(leak: str) -> dict[str, Form]:
    return {
        "laminar": Form(_laminar(leak)),
        "transition": Form(_transition(leak), {"transition": up(3e5, 3e6)}),
    }


FORMS: Final[Mapping[str, Mapping[str, Form]]] = {
    "valve_deadband": {
        "rounded": Form(_rounded_overlap, {"rounding": even(0.3, 1.0)}),
        "uneven": Form(_uneven_overlap, {"uneven": even(0.3, 0.8)}),
    },
    "valve_underlap_leakage": {"soft": Form(_soft_underlap), "rounded": Form(_round_underlap)},
    "valve_flow_asymmetry": {
        "comes up": Form(_loss_that_comes_up, {"reach": up(3e-5, 1.5e-4)}),
        "tank edge": Form(_loss_to_tank),
    },
    "valve_hysteresis": {"Bouc-Wen": Form(_smooth_hysteresis, {"reach": even(0.5, 3.0)})},
    "valve_bandwidth": {"first order and delay": Form(_first_order_spool)},
    "valve_rate_limit": {"hyperbolic tangent": Form(_soft_rate_limit)},
    "command_delay": {"slower hold": Form(_slower_hold)},
    "entrained_air": {
        "polytropic": Form(_polytropic_air, {"exponent": even(1.2, 1.4)}),
        "dissolving": Form(_dissolving_air, {"gone": even(3e6, 1.2e7)}),
    },
    "bulk_modulus": {"stiffening": Form(_stiffening_oil)},
    "supply_droop": {"linear": Form(_droop(1.0)), "smooth pipe": Form(_droop(1.75))},
    "supply_ripple": {"rectified": Form(_rectified_ripple)},
    "return_back_pressure": {"linear": Form(_rise(1.0)), "smooth pipe": Form(_rise(1.75))},
    "friction_asymmetry": {"half viscous": Form(_direction_drag)},
    "stiction_level": _STRIBECK,
    "coulomb_level": {"by pressure": Form(_level_by_pressure, {"share": even(0.3, 1.0)})},
    "stribeck_velocity": _STRIBECK,
    "viscous_friction": {"power 0.7": Form(_power_drag)},
    "presliding_compliance": {
        "Dahl": Form(_dahl, {"exponent": even(0.5, 1.5)}),
        "Bouc-Wen": Form(_bouc_wen, {"exponent": even(1.0, 2.0), "share": even(0.5, 0.95)}),
        "damping by speed": Form(_damping_by_speed, {"damping_speed": up(2e-3, 5e-2)}),
        "steady damping": Form(_steady_damping),
    },
    "internal_leakage": _leak_forms("leak_across"),
    "external_leakage_1": _leak_forms("leak_1"),
    "external_leakage_2": _leak_forms("leak_2"),
    "spring_load": {"hardening": Form(_hardening_spring, {"hardening": up(0.02, 0.1)})},
    "end_stop": {
        "Hertz": Form(_hertz_stop),
        "Kelvin-Voigt": Form(_kelvin_voigt_stop, {"damping": up(1e3, 1e4)}),
    },
    "pressure_1_gain": {"curved": Form(_curved_gauge(1))},
    "pressure_2_gain": {"curved": Form(_curved_gauge(2))},
    "pressure_lag": {"second order": Form(_ringing_gauges, {"damping": even(0.4, 1.0)})},
    "position_gain": {"curved": Form(_curved_encoder)},
    "position_delay": {"filter": Form(_filtered_encoder)},
    "position_backlash": {"soft contact": Form(_soft_backlash, {"reach": even(0.3, 1.5)})},
}
"""Forms by effect and name. A null bias, a supply's pressure, a transducer's zero, a constant force
and a mass are numbers and have no other formula."""
