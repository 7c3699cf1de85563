from .bands import band_powers as band_powers, edges as edges
from .compile_plant import build as build, nuisances as nuisances
from .description import PlantDescription as PlantDescription, PlantError as PlantError
from .description_checks import check_description as check_description
from .interface import (
    DRIVE as DRIVE,
    DRIVE_IN_LANES as DRIVE_IN_LANES,
    READ as READ,
    READ_IN_LANES as READ_IN_LANES,
    REMEMBER as REMEMBER,
    REMEMBER_IN_LANES as REMEMBER_IN_LANES,
    STEP as STEP,
    STEP_IN_LANES as STEP_IN_LANES,
    Array as Array,
    Effect as Effect,
    Equation as Equation,
    Held as Held,
    InLanes as InLanes,
    Knob as Knob,
    Motion as Motion,
    Nuisance as Nuisance,
    Output as Output,
    Parameter as Parameter,
    Plant as Plant,
    Proposal as Proposal,
    Region as Region,
    State as State,
    Trace as Trace,
)
from .records import (
    BoolArray as BoolArray,
    Gains as Gains,
    Record as Record,
    made_of as made_of,
    record_of as record_of,
    roughness as roughness,
    seen_parts as seen_parts,
    smoothed as smoothed,
)
from .terms import (
    DIRECTION as DIRECTION,
    TIME_NAME as TIME_NAME,
    Term as Term,
    dictionary as dictionary,
)
