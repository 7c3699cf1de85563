"""What can be hidden that the catalogue has not: kinds, places and sizes, and what is right to say.

A kind has variants, which differ in where the effect enters or in which quantity it depends on. For
each variant there are the answers that are right: several may be, because what is recorded is the
same, or because an equation can be written in several ways.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

from tools.hidden_effects.sizes import Sizes, either_way, even, up


@dataclass(frozen=True)
class Place:
    """Answers on an effect off the menu that are right: any equation with any quantity and shape.

    Attributes:
        equations: where the effect enters, in the words of `rig gap --json`: an equation, a
            reading, or a parameter that changes.
        of: quantities that it depends on; "" means none.
        shapes: names of its shape.
    """

    equations: tuple[str, ...]
    of: tuple[str, ...]
    shapes: tuple[str, ...]


@dataclass(frozen=True)
class Variant:
    """One way in which a kind of effect enters.

    Attributes:
        sizes: distributions of the rig's values that are set, SI, by their names in `RigValues`.
            Those of a moment (`..._at`) are shares of the recording; a place (`..._place`) is
            drawn from what the first motion reaches, whatever its distribution.
        places: what is right to say of it.
    """

    sizes: Mapping[str, Sizes]
    places: tuple[Place, ...]


def _just(value: float) -> Sizes:
    return even(value, value)


_THERE: Final = _just(0.0)
"""For places, which are drawn later because they depend on the motion."""
_PHASE: Final = even(0.0, 2.0 * pi)
_MOMENT: Final = even(0.3, 0.7)

_FORCE: Final = ("force balance",)
_DRAG: Final = ("viscous friction",)
_LEVEL: Final = ("friction level",)
_LEAK: Final = ("leak across the piston",)
_SPOOL: Final = ("spool", "command")
_EDGES: Final = ("valve edges", "null of the spool")
_SUPPLY: Final = ("supply pressure", "valve edges")
_ENCODER: Final = ("reading of position",)
_NONE: Final = ("", "time")
_BY_PLACE: Final = ("position x velocity", "velocity x position", "position x direction")
_DRIVE: Final = ("", "command", "spool opening")
_BUMP: Final = ("local_in_position", "depends_on_position")
_WAVE: Final = ("periodic_in_position",)
_LONG_WAVE: Final = ("periodic_in_position", "depends_on_position")
_PRESSED: Final = ("grows_with_pressure", "depends_on_pressure")
_BEYOND: Final = ("threshold", "grows_with_pressure", "depends_on_pressure")
_FAST: Final = ("power_of_velocity", "depends_on_velocity")
_SOFTENING: Final = Place(("bulk modulus",), ("time",), ("trend",))
_EITHER_PRESSURE: Final = ("pressure 1", "pressure 2", "pressure difference")
_SEAL: Final = (
    Place(_FORCE, tuple(f"{name} x direction" for name in _EITHER_PRESSURE), _PRESSED),
    Place(_LEVEL, _EITHER_PRESSURE, _PRESSED),
)
"""Of a symmetric ram behind a closed-centre valve, both pressures add up to the supply's while it
moves: a function of one is a function of the other, and of their difference."""


def _flow(chamber: int) -> tuple[str, ...]:
    return (f"flow, chamber {chamber}",)


def _gauge(chamber: int) -> tuple[str, ...]:
    return (f"reading of pressure {chamber}",)


def _worn(field: str, equations: tuple[str, ...], low: float, high: float) -> Variant:
    sizes = {field: up(low, high), "worn_place": _THERE, "worn_width": up(0.01, 0.05)}
    return Variant(sizes, (Place(equations, ("position",), _BUMP),))


def _relief(only: int) -> Variant:
    sizes = {"relief_leak": up(5e-12, 3e-11), "relief_pressure": even(7.4e6, 8.2e6)}
    if only:
        sizes["relief_only"] = _just(only)
    return Variant(
        sizes,
        tuple(
            Place(_flow(side), (f"pressure {side}",), _BEYOND)
            for side in (1, 2)
            if only in (0, side)
        ),
    )


def _pocket(chamber: int) -> Variant:
    sizes = {f"pocket_{chamber}": up(1e-13, 6e-13), "pocket_lag": up(4e-3, 5e-2)}
    place = Place(
        (f"flow, chamber {chamber}", "bulk modulus"),
        ("", "time", f"pressure {chamber}"),
        ("lag", "resonance"),
    )
    return Variant(sizes, (place,))


def _loose(field: str, sizes: Sizes, equations: tuple[str, ...]) -> Variant:
    found = {field: sizes, ("opens_at" if field.startswith("opening") else "loose_at"): _MOMENT}
    return Variant(found, (Place(equations, ("time",), ("step_in_time",)),))


def _tone(field: str, sizes: Sizes, equations: tuple[str, ...], hz: Sizes) -> Variant:
    found = {field: sizes, "tone_frequency": hz, "tone_phase": _PHASE}
    return Variant(found, (Place(equations, _NONE, ("tone",)),))


def _of_gauges(field: str, sizes: Sizes, of: str, shape: str) -> tuple[Variant, ...]:
    return tuple(
        Variant(
            {f"gauge_{side}_{field}": sizes},
            (Place(_gauge(side), tuple(of.format(side).split(" or ")), (shape,)),),
        )
        for side in (1, 2)
    )


def _stuck(reading: int, equations: tuple[str, ...]) -> Variant:
    sizes = {"stuck_reading": _just(reading), "loose_at": _MOMENT}
    return Variant(sizes, (Place(equations, _NONE, ("stuck_channel",)),))


FIRST_TWELVE: Final = (
    "tight_spot", "pilot_resonance", "warming_oil", "cogging", "pressed_seal", "drifting_null",
    "worn_place", "leaking_relief", "square_drag", "encoder_wave", "jittering_command",
    "fading_valve",
)  # fmt: skip
"""Kinds of the trials `off_menu`, if not all are asked for; of each, the first variant."""

OFF_MENU: Final[Mapping[str, tuple[Variant, ...]]] = {
    "tight_spot": (
        Variant(
            {
                "tight_spot": up(400.0, 1500.0),
                "tight_place": _THERE,
                "tight_width": up(0.01, 0.05),
            },
            (
                Place(_FORCE, ("position x direction",), _BUMP),
                Place(_LEVEL, ("position",), _BUMP),
            ),
        ),
    ),
    "pilot_resonance": (
        Variant(
            {"pilot_frequency": up(120.0, 500.0), "pilot_damping": up(0.05, 0.2)},
            (Place(_SPOOL, (*_NONE, *_DRIVE), ("resonance",)),),
        ),
    ),
    "warming_oil": (
        Variant({"oil_trend": Sizes(((0.012, 0.025), (-0.03, -0.015)))}, (_SOFTENING,)),
    ),
    "cogging": (
        Variant(
            {"cogging": up(300.0, 1500.0), "cogging_pitch": up(0.008, 0.06)},
            (Place(_FORCE, ("position",), _WAVE),),
        ),
        Variant(
            {
                "cogging": up(300.0, 1500.0),
                "cogging_pitch": up(0.06, 0.15),
                "cogging_phase": _PHASE,
            },
            (Place(_FORCE, ("position",), _WAVE),),
        ),
    ),
    "pressed_seal": (
        Variant({"squeeze": up(1e-11, 4e-11)}, _SEAL),
        Variant({"squeeze_2": up(1e-11, 4e-11)}, _SEAL),
    ),
    "drifting_null": (
        Variant({"null_trend": either_way(4e-7, 2e-6)}, (Place(_EDGES, ("time",), ("trend",)),)),
    ),
    "worn_place": (
        _worn("worn_leak", _LEAK, 6e-9, 3e-8),
        _worn("worn_leak_1", _flow(1), 3e-9, 1.5e-8),
        _worn("worn_leak_2", _flow(2), 3e-9, 1.5e-8),
    ),
    "leaking_relief": (_relief(0), _relief(1), _relief(2)),
    "square_drag": (
        Variant(
            {"drag_square": up(3e3, 2e4)},
            (
                Place(_FORCE, ("velocity", "velocity x direction"), _FAST),
                Place(_DRAG, ("velocity",), _FAST),
            ),
        ),
    ),
    "encoder_wave": (
        Variant(
            {"encoder_wave": up(2e-4, 8e-4), "encoder_pitch": up(0.008, 0.04)},
            (Place(_ENCODER, ("position",), _WAVE),),
        ),
    ),
    "jittering_command": (
        Variant(
            {"dead_time_jitter": up(6e-3, 0.02)},
            (Place(_SPOOL, (*_NONE, *_DRIVE), ("random_delay",)),),
        ),
    ),
    "fading_valve": (
        Variant(
            {"valve_heat": up(8e-3, 0.02)},
            (Place((*_SPOOL, "spool per volt"), ("time",), ("trend",)),),
        ),
    ),
    # A second mass on a spring: a payload that is not bolted down stiffly.
    "second_mass": (
        Variant(
            {
                "hung_mass": up(15.0, 150.0),
                "hung_frequency": up(25.0, 200.0),
                "hung_damping": up(0.02, 0.15),
            },
            (Place(_FORCE, (*_NONE, "position", "velocity"), ("resonance",)),),
        ),
    ),
    # Something comes loose, at a moment of each recording.
    "came_loose": (
        _loose("loose_force", either_way(200.0, 1500.0), _FORCE),
        _loose("loose_null", either_way(6e-6, 4e-5), _EDGES),
        _loose("loose_gauge_1", either_way(2e5, 1e6), _gauge(1)),
        _loose("loose_gauge_2", either_way(2e5, 1e6), _gauge(2)),
        _loose("opening_leak_1", up(1e-9, 6e-9), _flow(1)),
        _loose("opening_leak_2", up(1e-9, 6e-9), _flow(2)),
        _loose("opening_leak_across", up(2e-9, 1e-8), _LEAK),
    ),
    # A tone in time, with another phase in each recording: a machine beside the rig, or the mains.
    "tone": (
        _tone("tone_force", up(200.0, 800.0), _FORCE, up(6.0, 60.0)),
        _tone("tone_flow_1", up(4e-6, 2e-5), ("flow, chamber 1",), up(6.0, 60.0)),
        _tone("tone_flow_2", up(4e-6, 2e-5), ("flow, chamber 2",), up(6.0, 60.0)),
        _tone("tone_spool", up(3e-6, 2e-5), _SPOOL, up(6.0, 60.0)),
        _tone("tone_gauge_1", up(8e4, 4e5), _gauge(1), up(6.0, 150.0)),
        _tone("tone_gauge_2", up(8e4, 4e5), _gauge(2), up(6.0, 150.0)),
    ),
    "mixed_up_channels": (
        Variant(
            {"swapped_gauges": _just(1.0)},
            (
                Place(
                    (*_gauge(1), *_gauge(2)),
                    (*_NONE, "pressure 1", "pressure 2"),
                    ("mixed_up_channel",),
                ),
            ),
        ),
    ),
    "stuck_channel": (
        _stuck(2, _gauge(1)),
        _stuck(3, _gauge(2)),
        _stuck(4, ("reading of spool",)),
    ),
    # A check valve between the chambers that cracks at a pressure difference.
    "cracking_valve": (
        Variant(
            {"cross_relief": up(5e-12, 3e-11), "cross_pressure": even(1e6, 2.5e6)},
            (Place(_LEAK, ("pressure difference",), _BEYOND),),
        ),
    ),
    "gauge_hysteresis": _of_gauges("play", up(2e5, 6e5), "pressure {}", "play"),
    # The encoder's wheel runs off its centre: one turn is a good part of the stroke.
    "eccentric_encoder": (
        Variant(
            {
                "encoder_wave": up(5e-4, 3e-3),
                "encoder_pitch": up(0.08, 0.3),
                "encoder_phase": _PHASE,
            },
            (Place(_ENCODER, ("position",), _LONG_WAVE),),
        ),
    ),
    # Viscous friction that is more at one place: the bore is rough there.
    "rough_bore": (
        Variant(
            {
                "rough_drag": up(2e3, 1e4),
                "tight_place": _THERE,
                "tight_width": up(0.02, 0.08),
            },
            (
                Place(_FORCE, _BY_PLACE, _BUMP),
                Place(_DRAG, ("position",), _BUMP),
            ),
        ),
    ),
    "drifting_gauge": _of_gauges("drift", either_way(1.5e4, 6e4), "time", "trend"),
    # Silt holds a spool that has rested until it is asked for a good way.
    "silted_spool": (
        Variant(
            {"silt": up(8e-6, 4e-5)},
            (Place(_SPOOL, (*_NONE, *_DRIVE), ("threshold", "play")),),
        ),
    ),
    # A pocket of air in a dead end (bleed screw, gauge line) behind a narrow bore.
    "air_pocket": (_pocket(1), _pocket(2)),
    # The rod hangs over the further, the further it is out, and presses on its bearing.
    "side_load": (
        Variant(
            {"side_load": up(1.5e3, 8e3)},
            (
                Place(_FORCE, ("position x direction",), ("depends_on_position",)),
                Place(_LEVEL, ("position",), ("depends_on_position",)),
            ),
        ),
    ),
    # A weight on a crank that the ram turns.
    "crank_load": (
        Variant(
            {
                "cogging": up(500.0, 2500.0),
                "cogging_pitch": up(0.4, 1.0),
                "cogging_phase": _PHASE,
            },
            (Place(_FORCE, ("position",), _LONG_WAVE),),
        ),
    ),
    # A cushion that throttles the oil towards the end of the stroke, set too far inwards.
    "cushion": (
        Variant(
            {"cushion": up(5e5, 4e6), "cushion_place": _THERE},
            (
                Place(_FORCE, _BY_PLACE, ("threshold", *_BUMP)),
                Place(_DRAG, ("position",), ("threshold", *_BUMP)),
            ),
        ),
    ),
    # The valve's current shows in a pressure reading, by a shared ground.
    "crosstalk": _of_gauges(
        "crosstalk", either_way(8e4, 4e5), "command or spool opening", "depends_on_opening"
    ),
    # The valve's amplifier passes less than its command asks.
    "clipped_amplifier": (
        Variant(
            {"amplifier_volts": up(0.5, 1.5)},
            (Place((*_SPOOL, "spool per volt"), (*_NONE, *_DRIVE), ("saturation",)),),
        ),
    ),
    # The pump's pressure regulator hunts, slower than any ripple of its pistons.
    "hunting_pump": (_tone("tone_supply", up(3e5, 1.2e6), _SUPPLY, up(0.4, 3.0)),),
}
"""Variants of each kind by its name."""

IDEAS: Final = (
    "silted_spool", "air_pocket", "side_load", "crank_load", "cushion", "crosstalk",
    "clipped_amplifier", "hunting_pump",
)  # fmt: skip
"""Kinds that were thought up by somebody who had not read how the workflow searches."""
