"""The catalogue of effects that may be switched on in a model, and models of one rig.

Each effect is neutral at its parameters' defaults, so that a model with it contains the simpler
model as a special case. Simulation, filters and gap workflow share the catalogue. Some effects add
a term; others shift a parameter that every rig has, and are neutral at the model's present value.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from .added_terms import AddedTerm
from .parameters import NOMINAL, Parameters, quantities

_QUANTITIES: Final = quantities()


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """One knob (parameter) of an effect.

    Attributes:
        name: name of the knob in a model file.
        field: field of `Parameters` that it sets.
        lower, upper: plausible range on a rig, SI; a model file may go beyond it, up to the range
            of the field's `Quantity`.
        shift: whether every rig has the parameter, so that the effect only shifts it.
        followed_by: another field of `Parameters` that is scaled along with this one; or None.
    """

    name: str
    field: str
    lower: float
    upper: float
    shift: bool = False
    followed_by: str | None = None

    @property
    def unit(self) -> str:
        """Return the SI unit of the knob."""
        return _QUANTITIES[self.field].unit

    @property
    def neutral(self) -> float:
        """Return the knob's SI value without the effect; for a shift, that of the nominal rig."""
        return float(getattr(NOMINAL, self.field))


@dataclass(frozen=True, slots=True)
class PlantEffect:
    """A physical effect that a model may have, with its equation, source and knobs."""

    name: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]

    @property
    def shifts(self) -> bool:
        """Return whether the effect only shifts parameters that every rig has."""
        return all(parameter.shift for parameter in self.parameters)

    def applied(self, parameters: Parameters, **values: float) -> Parameters:
        """Return a rig's parameters with some knobs of this effect set.

        The field in a knob's `followed_by` is scaled by the same factor. Ranges are not checked.

        Args:
            parameters: parameters of the rig before, which do not change.
            **values: SI value of each knob to set, by the knob's name.

        Raises:
            KeyError: the effect has no knob of that name.
        """
        knobs = {knob.name: knob for knob in self.parameters}
        changed = {}
        for name, value in values.items():
            knob = knobs[name]
            changed[knob.field] = value
            if knob.followed_by:
                before = getattr(parameters, knob.field)
                kept = getattr(parameters, knob.followed_by)
                changed[knob.followed_by] = kept if value == before else value * (kept / before)
        return parameters._replace(**changed)


_Span = tuple[float, float]


def _knob(name: str, field: str, span: _Span | None = None, **options: Any) -> EffectParameter:
    """Return a knob; without a span, its range is that of the field's `Quantity`."""
    lower, upper = span or (_QUANTITIES[field].lower, _QUANTITIES[field].upper)
    return EffectParameter(name, field, lower, upper, **options)


def _effect(name: str, equation: str, source: str, *knobs: EffectParameter) -> PlantEffect:
    return PlantEffect(name, equation, source, knobs)


def _added(name: str, equation: str, source: str, span: _Span | None = None) -> PlantEffect:
    """Return an effect with one knob, "value", for a parameter that has the effect's name."""
    return _effect(name, equation, source, _knob("value", name, span))


def _shift(
    name: str, equation: str, source: str, field: str, span: _Span, followed_by: str | None = None
) -> PlantEffect:
    """Return an effect whose one knob, "value", is the new value of a parameter every rig has.

    `field` names the parameter, and `followed_by` one that is scaled by the same factor.
    """
    knob = _knob("value", field, span, shift=True, followed_by=followed_by)
    return _effect(name, equation, source, knob)


def _leak(name: str, equation: str) -> PlantEffect:
    knobs = (_knob("value", name, (0.0, 2e-8)), _knob("linear", f"{name}_linear", (0.0, 1e-11)))
    return PlantEffect(name, equation, "eqs. 5.1 and 5.2", knobs)


_EFFECTS: Final = (
    # Valve
    _added("spool_null_bias", "y = x_sp + b_sp", "section 3.2.1"),
    _added("valve_deadband", "y -> sgn(y) max(0, |y| - d_o)", "Merritt 1967, ch. 5", (0.0, 5e-5)),
    _added(
        "valve_underlap_leakage",
        "edges open by max(0, u_o + y) and max(0, u_o - y)",
        "Merritt 1967, ch. 5: an open-centre valve",
        (0.0, 5e-5),
    ),
    _added("valve_flow_asymmetry", "q_2 -> (1 - a_v) q_2", "Merritt 1967, ch. 5", (-0.3, 0.3)),
    _added(
        "valve_hysteresis",
        "r -> min(max(r, k_sp u - h_v), k_sp u + h_v) in place of k_sp u",
        "Merritt 1967, ch. 6: play between torque motor and spool",
        (0.0, 2e-5),
    ),
    _shift("valve_bandwidth", "omega_n", "eq. 2.5", "valve_natural_frequency", (200.0, 2000.0)),
    _added(
        "valve_rate_limit", "|dx_sp/dt| <= w_max", "Merritt 1967, ch. 7: pilot stage", (5e-3, 1e3)
    ),
    _added("command_delay", "u(t - tau_u) in place of u(t)", "transport delay"),
    # Oil
    _added(
        "entrained_air",
        "1/beta_e = [(1 - a)/beta + a r^2/p_a] / [1 - a + a r], r = p_a/(p + p_a)",
        "Merritt 1967, ch. 2: bubbles at the pressure of the oil, isothermal",
        (0.0, 0.05),
    ),
    _shift("bulk_modulus", "beta", "eq. 2.3; Merritt 1967, ch. 2", "bulk_modulus", (2e8, 2e9)),
    # Supply and return
    _shift(
        "supply_pressure",
        "p_s0",
        "section 1.2.2: pump faults shift the supply pressure",
        "supply_pressure",
        (5e6, 2.5e7),
    ),
    _added("supply_droop", "p_s = p_s0 - R_s q_s^2", "Merritt 1967, ch. 3", (0.0, 2e13)),
    _effect(
        "supply_ripple",
        "p_s + A_r sin(2 pi f_r t + phi_r) at the valve",
        "Merritt 1967, ch. 3: flow pulses of the pump's pistons",
        _knob("amplitude", "supply_ripple", (0.0, 1e6)),
        _knob("frequency", "supply_ripple_frequency", (5.0, 400.0)),
        _knob("phase", "supply_ripple_phase"),
    ),
    _added("return_back_pressure", "p_e = p_e0 + R_e q_e^2", "Merritt 1967, ch. 3", (0.0, 2e13)),
    # Friction
    _added(
        "friction_asymmetry",
        "g(v) + F_as sgn(v): more friction when extending, less when retracting",
        "sections 3.2.1 and 7.2.1",
    ),
    _shift("stiction_level", "f_st alone", "eq. 2.8; section 3.1", "stiction", (0.0, 8e3)),
    _shift(
        "coulomb_level",
        "f_sl, and f_st in proportion",
        "eq. 2.8; section 3.1",
        "coulomb",
        (100.0, 4e3),
        "stiction",
    ),
    _shift("stribeck_velocity", "alpha", "eq. 2.8", "stribeck_velocity", (5e-3, 0.3)),
    _shift("viscous_friction", "d", "eq. 2.8", "viscous", (0.0, 3e3)),
    _shift(
        "presliding_compliance",
        "s_0, softer than the nominal",
        "Canudas de Wit et al. 1995",
        "bristle_stiffness",
        (5e5, 2e7),
    ),
    # Leaks
    _leak("internal_leakage", "q_il = k_il sgn(p1 - p2) sqrt|p1 - p2| + k_lin (p1 - p2)"),
    _leak("external_leakage_1", "q_el1 = k_el1 sqrt(p1 - p_e) + k_lin (p1 - p_e)"),
    _leak("external_leakage_2", "q_el2 = k_el2 sqrt(p2 - p_e) + k_lin (p2 - p_e)"),
    # Environment
    _effect(
        "spring_load",
        "F_r = K_spring max(0, x_a - x_c)",
        "sections 6.1, 7.1.1 and 7.2",
        _knob("stiffness", "spring_stiffness", (0.0, 1e6)),
        _knob("contact", "spring_contact", (0.0, 0.6)),
    ),
    _added("constant_force", "F_r + F_0", "eq. 6.8: a weight, or a load held", (-5e3, 5e3)),
    _added("payload_mass", "(m_a + m_p) dv/dt", "eq. 2.6", (0.0, 500.0)),
    _effect(
        "end_stop",
        "K_stop delta max(0, 1 + chi v) at depth delta beyond x_low, x_high",
        "Hunt and Crossley 1975; the stroke's ends, where nothing stops the ram before",
        _knob("stiffness", "stop_stiffness", (1e6, 6e7), shift=True),
        _knob("low", "stop_low", (-0.1, 0.6)),
        _knob("high", "stop_high", (0.0, 5.0)),
    ),
    # Transducers
    _added("pressure_1_bias", "reading + b_1", "zero of a transducer", (-1e6, 1e6)),
    _added("pressure_2_bias", "reading + b_2", "zero of a transducer", (-1e6, 1e6)),
    _added("pressure_1_gain", "g_1 p1 (+ b_1)", "span of a transducer", (0.8, 1.2)),
    _added("pressure_2_gain", "g_2 p2 (+ b_2)", "span of a transducer", (0.8, 1.2)),
    _added("pressure_lag", "tau_p dy/dt = p - y, both", "snubber or filter"),
    _added("position_gain", "g_x x_a", "scale of the encoder", (0.9, 1.1)),
    _added("position_delay", "x_a(t - tau_x)", "transport delay"),
    _added(
        "position_backlash",
        "e -> min(max(e, x_a - b_x/2), x_a + b_x/2)",
        "play between ram and encoder",
        (0.0, 2e-3),
    ),
)

CATALOGUE: Final[dict[str, PlantEffect]] = {effect.name: effect for effect in _EFFECTS}

REMEMBERING: Final = (
    "command_delay",
    "valve_hysteresis",
    "supply_ripple",
    "pressure_lag",
    "position_delay",
    "position_backlash",
)
"""Fields of effects whose memory is outside the plant's state (`command_path`, `transducers`)."""


@dataclass(frozen=True)
class Model:
    """A model of one rig.

    Attributes:
        name: name of the model.
        parameters: parameters of the rig, SI, with the terms that the plant holds.
        effects: names of the effects switched on.
        provenance: where the model comes from.
        discovered: terms that the plant cannot hold (`rig.plant.is_held`); simulator and filters
            ignore them.
    """

    name: str = "nominal"
    parameters: Parameters = Parameters()
    effects: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    discovered: tuple[AddedTerm, ...] = ()

    def with_effect(self, name: str, **values: float) -> "Model":
        """Return a copy of this model with an effect of the catalogue switched on.

        An effect that shifts a parameter which every rig has is given the new value itself, not a
        difference (`bulk_modulus`: beta). `coulomb_level` also changes the stiction in proportion,
        and `stiction_level` the stiction alone; of the two, it must therefore be set last.

        Args:
            name: name of the effect.
            **values: SI value of each of its knobs to set, by the knob's name; the other knobs stay
                as they are, and ranges are not checked.

        Raises:
            KeyError: the effect, or one of its knobs, is not in the catalogue.
        """
        parameters = CATALOGUE[name].applied(self.parameters, **values)
        effects = self.effects if name in self.effects else (*self.effects, name)
        return replace(self, parameters=parameters, effects=effects)
