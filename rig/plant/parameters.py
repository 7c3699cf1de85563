"""All parameters of the rig, each with its default, unit, plausible range, symbol and source.

All values are SI. A parameter that belongs to an effect of the catalogue (`rig.plant.effects`) has
as its default the value at which the effect is absent.
"""

from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple, get_args, get_type_hints

LITRE_PER_MINUTE: Final = 1e-3 / 60.0
"""One L/min in m^3/s; the thesis rounds it to 1.67e-5 (eq. 5.3)."""
GALLON_PER_MINUTE: Final = 231.0 * 0.0254**3 / 60.0
"""One US gallon, 231 cubic inches, in a minute, in m^3/s (NIST SP 811, appendix B)."""
PSI: Final = 4.4482216152605 / 0.0254**2
"""One pound-force on a square inch in Pa, by the definitions of both (NIST SP 811, appendix B)."""

BRISTLE: Final = 0.0
KARNOPP: Final = 1.0
MOST_TABLES: Final = 2
MOST_KNOTS: Final = 9
"""Greatest numbers of tables among the added terms, and of knots of a table."""
FRICTION_LAWS: Final = {"bristle": BRISTLE, "karnopp": KARNOPP}


@dataclass(frozen=True, slots=True)
class Quantity:
    """SI unit, plausible range in that unit, symbol and source of one parameter."""

    unit: str
    lower: float
    upper: float
    symbol: str
    source: str


_q = Quantity


class Parameters(NamedTuple):
    """Physical parameters of one rig in SI units; compiled plant and filters take this tuple."""

    # Cylinder
    piston_area: Annotated[float, _q("m^2", 1e-4, 1e-2, "A", "table 2.1")] = 6.33e-4
    moving_mass: Annotated[float, _q("kg", 1.0, 1000.0, "m_a", "table 2.1")] = 10.0
    stroke_min: Annotated[float, _q("m", -0.1, 1.0, "X_min", "table 2.1")] = 0.0
    stroke_max: Annotated[float, _q("m", 0.01, 5.0, "X_max", "table 2.1")] = 0.6069
    line_volume_1: Annotated[float, _q("m^3", 1e-6, 1e-3, "V_1^0", "table 2.1")] = 2.14e-5
    line_volume_2: Annotated[float, _q("m^3", 1e-6, 1e-3, "V_2^0", "table 2.1")] = 2.14e-5
    # Oil
    bulk_modulus: Annotated[float, _q("Pa", 5e7, 2.5e9, "beta", "table 2.1; Merritt 1967")] = 6.89e8
    entrained_air: Annotated[
        float, _q("", 0.0, 0.1, "a", "volume fraction at atmospheric pressure; Merritt 1967, ch. 2")
    ] = 0.0
    density: Annotated[float, _q("kg/m^3", 700.0, 1100.0, "rho", "table 2.1")] = 847.15
    # Supply and return
    supply_pressure: Annotated[float, _q("Pa", 1e6, 3.5e7, "p_s", "section 2.1")] = 13.8e6
    return_pressure: Annotated[float, _q("Pa", 0.0, 5e6, "p_e", "section 2.2")] = 0.0
    supply_droop: Annotated[
        float, _q("Pa/(m^3/s)^2", 0.0, 1e14, "R_s", "turbulent line loss, Merritt 1967, ch. 3")
    ] = 0.0
    return_back_pressure: Annotated[
        float, _q("Pa/(m^3/s)^2", 0.0, 1e14, "R_e", "turbulent line loss, Merritt 1967, ch. 3")
    ] = 0.0
    supply_ripple: Annotated[
        float, _q("Pa", 0.0, 3e6, "A_r", "pump ripple at the valve, Merritt 1967, ch. 3")
    ] = 0.0
    supply_ripple_frequency: Annotated[
        float, _q("Hz", 1.0, 450.0, "f_r", "pistons of the pump times its speed")
    ] = 225.0
    supply_ripple_phase: Annotated[
        float, _q("rad", -6.3, 6.3, "phi_r", "at the start of a test; no pump is in step with one")
    ] = 0.0
    line_time_constant: Annotated[
        float, _q("s", 1e-3, 0.1, "tau_l", "filling of the supply and return lines")
    ] = 2e-3
    # Servovalve
    discharge_coefficient: Annotated[
        float, _q("", 0.3, 0.9, "C_d", "table 2.1 as corrected (docs/model.md)")
    ] = 0.6
    area_gradient: Annotated[float, _q("m^2/m", 1e-3, 0.2, "w", "table 2.1")] = 2.075e-2
    valve_gain: Annotated[
        float, _q("m/V", 1e-6, 1e-3, "k_sp", "table 2.1 as corrected (docs/model.md)")
    ] = 2.794e-5
    valve_natural_frequency: Annotated[float, _q("rad/s", 50.0, 5000.0, "omega_n", "table 2.1")] = (
        628.3185307179587
    )
    valve_damping: Annotated[float, _q("", 0.1, 2.0, "d_m", "table 2.1")] = 0.7
    spool_null_bias: Annotated[
        float, _q("m", -5e-5, 5e-5, "b_sp", "section 3.2.1: the measured spool shows a bias")
    ] = 0.0
    valve_deadband: Annotated[
        float, _q("m", 0.0, 1e-4, "d_o", "overlap of each edge, Merritt 1967, ch. 5")
    ] = 0.0
    valve_underlap_leakage: Annotated[
        float, _q("m", 0.0, 1e-4, "u_o", "underlap of each edge, Merritt 1967, ch. 5")
    ] = 0.0
    valve_flow_asymmetry: Annotated[
        float, _q("", -0.5, 0.5, "a_v", "edges of the two ports unlike, Merritt 1967, ch. 5")
    ] = 0.0
    valve_hysteresis: Annotated[
        float, _q("m", 0.0, 5e-5, "h_v", "play before the spool, Merritt 1967, ch. 6")
    ] = 0.0
    valve_rate_limit: Annotated[
        float, _q("m/s", 1e-3, 1e3, "w_max", "flow of the pilot stage, Merritt 1967, ch. 7")
    ] = 1e3
    command_delay: Annotated[
        float, _q("s", 0.0, 0.02, "tau_u", "transport in amplifier and network")
    ] = 0.0
    # Friction
    friction_law: Annotated[float, _q("", 0.0, 1.0, "", "0 bristle, 1 Karnopp (docs/model.md)")] = (
        BRISTLE
    )
    stiction: Annotated[float, _q("N", 0.0, 2e4, "f_st", "table 2.1; section 3.1")] = 2.4e3
    coulomb: Annotated[float, _q("N", 0.0, 2e4, "f_sl", "table 2.1; section 3.1")] = 1.1e3
    stribeck_velocity: Annotated[float, _q("m/s", 1e-3, 1.0, "alpha", "table 2.1")] = 0.04
    viscous: Annotated[float, _q("N s/m", 0.0, 1e4, "d", "table 2.1")] = 350.0
    stick_velocity: Annotated[
        float, _q("m/s", 1e-5, 0.05, "v_o", "table 2.1; eq. 2.16, used by the thesis filters only")
    ] = 1e-3
    bristle_stiffness: Annotated[
        float, _q("N/m", 1e5, 1e9, "s_0", "Canudas de Wit et al. 1995; value in docs/model.md")
    ] = 2e7
    bristle_damping: Annotated[
        float, _q("N s/m", 0.0, 1e6, "s_1", "Canudas de Wit et al. 1995; value in docs/model.md")
    ] = 2e4
    bristle_damping_velocity: Annotated[
        float, _q("m/s", 1e-4, 1.0, "v_s1", "docs/model.md: bristle damping fades when sliding")
    ] = 1e-2
    friction_asymmetry: Annotated[
        float, _q("N", -1e3, 1e3, "F_as", "section 3.2.1: extending and retracting differ")
    ] = 0.0
    # Environment
    spring_stiffness: Annotated[
        float, _q("N/m", 0.0, 5e6, "K_spring", "sections 6.1 and 7.1.1")
    ] = 0.0
    constant_force: Annotated[
        float, _q("N", -2e4, 2e4, "F_0", "weight or a load held, against extension; eq. 6.8")
    ] = 0.0
    payload_mass: Annotated[
        float, _q("kg", 0.0, 1000.0, "m_p", "what the ram carries, eq. 2.6")
    ] = 0.0
    spring_contact: Annotated[float, _q("m", -0.1, 5.0, "x_c", "sections 7.1.1 and 7.2")] = 0.22
    stop_stiffness: Annotated[
        float, _q("N/m", 1e6, 1e9, "K_stop", "stroke end as a stiff contact; docs/model.md")
    ] = 6e7
    stop_damping: Annotated[
        float, _q("s/m", 0.0, 100.0, "chi_stop", "contact losses, Hunt and Crossley 1975")
    ] = 5.0
    stop_low: Annotated[
        float, _q("m", -0.1, 5.0, "x_low", "a stop inside the stroke, else the stroke's end acts")
    ] = -0.1
    stop_high: Annotated[
        float, _q("m", -0.1, 5.0, "x_high", "a stop inside the stroke, else the stroke's end acts")
    ] = 5.0
    # Leaks
    internal_leakage: Annotated[
        float, _q("m^3/(s Pa^0.5)", 0.0, 1e-6, "k_il", "eq. 5.2, signed")
    ] = 0.0
    external_leakage_1: Annotated[float, _q("m^3/(s Pa^0.5)", 0.0, 1e-6, "k_el1", "eq. 5.2")] = 0.0
    external_leakage_2: Annotated[float, _q("m^3/(s Pa^0.5)", 0.0, 1e-6, "k_el2", "eq. 5.2")] = 0.0
    internal_leakage_linear: Annotated[float, _q("m^3/(s Pa)", 0.0, 1e-9, "k_il", "eq. 5.1")] = 0.0
    external_leakage_1_linear: Annotated[float, _q("m^3/(s Pa)", 0.0, 1e-9, "k_el1", "eq. 5.1")] = (
        0.0
    )
    external_leakage_2_linear: Annotated[float, _q("m^3/(s Pa)", 0.0, 1e-9, "k_el2", "eq. 5.1")] = (
        0.0
    )
    supply_leakage: Annotated[
        float, _q("m^3/(s Pa^0.5)", 0.0, 1e-6, "k_sl", "figure 2.3; law of eq. 5.2")
    ] = 0.0
    # Transducers
    pressure_1_bias: Annotated[float, _q("Pa", -2e6, 2e6, "b_1", "offset of a transducer")] = 0.0
    pressure_2_bias: Annotated[float, _q("Pa", -2e6, 2e6, "b_2", "offset of a transducer")] = 0.0
    pressure_1_gain: Annotated[float, _q("", 0.5, 1.5, "g_1", "span of a transducer")] = 1.0
    pressure_2_gain: Annotated[float, _q("", 0.5, 1.5, "g_2", "span of a transducer")] = 1.0
    pressure_lag: Annotated[
        float, _q("s", 0.0, 0.05, "tau_p", "snubber or filter of both transducers")
    ] = 0.0
    position_gain: Annotated[float, _q("", 0.5, 1.5, "g_x", "scale of the encoder")] = 1.0
    position_delay: Annotated[
        float, _q("s", 0.0, 0.02, "tau_x", "transport in encoder and network")
    ] = 0.0
    position_backlash: Annotated[
        float, _q("m", 0.0, 5e-3, "b_x", "play between ram and encoder, its full width")
    ] = 0.0
    # Added terms and the knots of their tables (rig.plant.added_terms). These fields have no
    # `Quantity`, as their units depend on the term.
    term_1_kind: float = 0.0
    term_1_size: float = 0.0
    term_1_at: float = 0.0
    term_1_by: float = 0.0
    term_2_kind: float = 0.0
    term_2_size: float = 0.0
    term_2_at: float = 0.0
    term_2_by: float = 0.0
    term_3_kind: float = 0.0
    term_3_size: float = 0.0
    term_3_at: float = 0.0
    term_3_by: float = 0.0
    table_1_at_1: float = 0.0
    table_1_value_1: float = 0.0
    table_1_at_2: float = 0.0
    table_1_value_2: float = 0.0
    table_1_at_3: float = 0.0
    table_1_value_3: float = 0.0
    table_1_at_4: float = 0.0
    table_1_value_4: float = 0.0
    table_1_at_5: float = 0.0
    table_1_value_5: float = 0.0
    table_1_at_6: float = 0.0
    table_1_value_6: float = 0.0
    table_1_at_7: float = 0.0
    table_1_value_7: float = 0.0
    table_1_at_8: float = 0.0
    table_1_value_8: float = 0.0
    table_1_at_9: float = 0.0
    table_1_value_9: float = 0.0
    table_2_at_1: float = 0.0
    table_2_value_1: float = 0.0
    table_2_at_2: float = 0.0
    table_2_value_2: float = 0.0
    table_2_at_3: float = 0.0
    table_2_value_3: float = 0.0
    table_2_at_4: float = 0.0
    table_2_value_4: float = 0.0
    table_2_at_5: float = 0.0
    table_2_value_5: float = 0.0
    table_2_at_6: float = 0.0
    table_2_value_6: float = 0.0
    table_2_at_7: float = 0.0
    table_2_value_7: float = 0.0
    table_2_at_8: float = 0.0
    table_2_value_8: float = 0.0
    table_2_at_9: float = 0.0
    table_2_value_9: float = 0.0


NOMINAL: Final = Parameters()


def quantities() -> dict[str, Quantity]:
    """Return the `Quantity` of every parameter by field name, without the fields of terms."""
    hints = get_type_hints(Parameters, include_extras=True)
    return {name: get_args(hint)[1] for name, hint in hints.items() if get_args(hint)}
