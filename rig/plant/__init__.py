"""The physics of the rig, once: parameters with units, rates, integrator, sensors, effects.

Imports numpy and numba only; everything above shares this one model.
"""

from .effects import CATALOGUE, REMEMBERING, Effect, EffectParameter
from .faults import FAULT_COLUMNS, NO_FAULT, FaultInput
from .model import Model
from .parameters import BRISTLE, FRICTION_LAWS, KARNOPP, NOMINAL, Parameters, Quantity, quantities

__all__ = [
    "BRISTLE",
    "CATALOGUE",
    "FAULT_COLUMNS",
    "FRICTION_LAWS",
    "KARNOPP",
    "NOMINAL",
    "NO_FAULT",
    "REMEMBERING",
    "Effect",
    "EffectParameter",
    "FaultInput",
    "Model",
    "Parameters",
    "Quantity",
    "quantities",
]
