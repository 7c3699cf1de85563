"""The effects of the gap workflow's catalogue, and how effects are hidden in the independent rig.

The menu is the catalogue of the gap workflow. For each effect of it, `MENU` has a function that
takes the rig's values and the effect's parameters, by their names in the catalogue, and returns the
values of the same rig with that effect.
"""

from collections.abc import Callable, Mapping
from typing import Final

from tools.hidden_effects.forms import CATALOGUE, FORMS
from tools.hidden_effects.off_menu import OFF_MENU
from tools.hidden_effects.rig_values import TABLE, RigValues

Parameters = Mapping[str, float]
Hide = Callable[[RigValues, Parameters], RigValues]


def _value(field: str) -> Hide:
    """Return a function that sets the rig's value `field` to the effect's parameter `value`."""

    def hide(rig: RigValues, effect: Parameters) -> RigValues:
        return rig._replace(**{field: effect["value"]})

    return hide


def _sliding_with_break_away(rig: RigValues, effect: Parameters) -> RigValues:
    level = effect["value"]
    return rig._replace(sliding=level, break_away=rig.break_away * level / rig.sliding)


def _payload(rig: RigValues, effect: Parameters) -> RigValues:
    return rig._replace(ram_mass=rig.ram_mass + effect["value"])


def _ripple(rig: RigValues, effect: Parameters) -> RigValues:
    return rig._replace(
        ripple=effect["amplitude"],
        ripple_frequency=effect["frequency"],
        ripple_phase=effect["phase"],
    )


def _spring(rig: RigValues, effect: Parameters) -> RigValues:
    return rig._replace(spring=effect["stiffness"], spring_contact=effect["contact"])


def _end_stop(rig: RigValues, effect: Parameters) -> RigValues:
    return rig._replace(
        stop_stiffness=effect.get("stiffness", TABLE.stop_stiffness),
        stroke_low=effect.get("low", TABLE.stroke_low),
        stroke_high=effect.get("high", TABLE.stroke_high),
    )


MENU: Final[dict[str, Hide]] = {
    "spool_null_bias": _value("null_shift"),
    "valve_deadband": _value("overlap"),
    "valve_underlap_leakage": _value("underlap"),
    "valve_flow_asymmetry": _value("port_2_loss"),
    "valve_hysteresis": _value("spool_play"),
    "valve_bandwidth": _value("spool_frequency"),
    "valve_rate_limit": _value("spool_speed"),
    "command_delay": _value("dead_time"),
    "entrained_air": _value("air"),
    "bulk_modulus": _value("oil_stiffness"),
    "supply_pressure": _value("pump_pressure"),
    "supply_droop": _value("pump_droop"),
    "supply_ripple": _ripple,
    "return_back_pressure": _value("tank_rise"),
    "friction_asymmetry": _value("direction_friction"),
    "stiction_level": _value("break_away"),
    "coulomb_level": _sliding_with_break_away,
    "stribeck_velocity": _value("stribeck"),
    "viscous_friction": _value("drag"),
    "presliding_compliance": _value("seal_stiffness"),
    "internal_leakage": _value("leak_across"),
    "external_leakage_1": _value("leak_1"),
    "external_leakage_2": _value("leak_2"),
    "spring_load": _spring,
    "constant_force": _value("push_back"),
    "payload_mass": _payload,
    "end_stop": _end_stop,
    "pressure_1_bias": _value("gauge_1_bias"),
    "pressure_2_bias": _value("gauge_2_bias"),
    "pressure_1_gain": _value("gauge_1_gain"),
    "pressure_2_gain": _value("gauge_2_gain"),
    "pressure_lag": _value("gauge_lag"),
    "position_gain": _value("encoder_gain"),
    "position_delay": _value("encoder_delay"),
    "position_backlash": _value("encoder_play"),
}


def with_effects(
    rig: RigValues, effects: Mapping[str, Parameters], forms: Mapping[str, str] | None = None
) -> RigValues:
    """Return the values of `rig` with effects added.

    Args:
        rig: values of the rig; they are not changed.
        effects: the parameters (SI) of each effect, by its name in `MENU` or `OFF_MENU`.
        forms: name of the form, by effect; effects that are not in it have the catalogue's.

    Raises:
        ValueError: an effect is in neither of them.
        KeyError: an effect lacks a parameter that it needs, or has not the form.
    """
    for name, parameters in effects.items():
        if name in MENU:
            rig = MENU[name](rig, parameters)
            form = (forms or {}).get(name, CATALOGUE)
            if form != CATALOGUE:
                rig = FORMS[name][form].shape(rig, parameters)
        elif name in OFF_MENU:
            rig = rig._replace(**parameters)
        else:
            known = ", ".join([*MENU, *OFF_MENU])
            raise ValueError(f"effect {name!r} is not known: one of {known}")
    return rig
