"""The catalogue of effects: what may be switched on in a model, and by which parameters.

Each effect is neutral at its parameters' defaults, so that switching one on is a nested extension
of the simpler model: simulation, filters and gap workflow share it.
"""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """One knob of an effect: its name in a model file and the field of `Parameters` it sets."""

    name: str
    field: str


@dataclass(frozen=True, slots=True)
class Effect:
    """A physical effect: equation, source and parameters."""

    name: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]


def _single(name: str, equation: str, source: str, field: str | None = None) -> Effect:
    return Effect(name, equation, source, (EffectParameter("value", field or name),))


_EFFECTS: Final = (
    _single("spool_null_bias", "opening = x_sp + b_sp", "section 3.2.1"),
    _single(
        "friction_asymmetry",
        "g(v) + F_as sgn(v): more friction when extending, less when retracting",
        "sections 3.2.1 and 7.2.1",
    ),
    _single(
        "entrained_air",
        "1/beta_e = [(1 - a)/beta + a r^2/p_a] / [1 - a + a r], r = p_a/(p + p_a)",
        "Merritt 1967, ch. 2: bubbles at the pressure of the oil, isothermal",
    ),
    Effect(
        "internal_leakage",
        "q_il = k_il sgn(p1 - p2) sqrt|p1 - p2| + k_lin (p1 - p2)",
        "eqs. 5.1 and 5.2",
        (
            EffectParameter("value", "internal_leakage"),
            EffectParameter("linear", "internal_leakage_linear"),
        ),
    ),
    Effect(
        "external_leakage_1",
        "q_el1 = k_el1 sqrt(p1 - p_e) + k_lin (p1 - p_e)",
        "eqs. 5.1 and 5.2",
        (
            EffectParameter("value", "external_leakage_1"),
            EffectParameter("linear", "external_leakage_1_linear"),
        ),
    ),
    Effect(
        "external_leakage_2",
        "q_el2 = k_el2 sqrt(p2 - p_e) + k_lin (p2 - p_e)",
        "eqs. 5.1 and 5.2",
        (
            EffectParameter("value", "external_leakage_2"),
            EffectParameter("linear", "external_leakage_2_linear"),
        ),
    ),
    Effect(
        "spring_load",
        "F_r = K_spring max(0, x_a - x_c)",
        "sections 6.1, 7.1.1 and 7.2",
        (
            EffectParameter("stiffness", "spring_stiffness"),
            EffectParameter("contact", "spring_contact"),
        ),
    ),
    _single("supply_pressure", "p_s", "section 1.2.2: pump faults shift the supply pressure"),
    _single("supply_droop", "p_s = p_s0 - R_s q_s^2", "Merritt 1967, ch. 3"),
    _single("return_back_pressure", "p_e = p_e0 + R_e q_e^2", "Merritt 1967, ch. 3"),
)

CATALOGUE: Final[dict[str, Effect]] = {effect.name: effect for effect in _EFFECTS}
