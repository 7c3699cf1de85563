from .break_away import BreakAway as BreakAway, break_aways as break_aways
from .curve import (
    CHANGE_PROBABILITY as CHANGE_PROBABILITY,
    FrictionCurve as FrictionCurve,
    FrictionEstimate as FrictionEstimate,
    friction_changes as friction_changes,
    identify_friction as identify_friction,
    identify_recording as identify_recording,
    model_curve as model_curve,
)
from .fit import PARAMETERS as PARAMETERS
from .joint import (
    DISAGREEMENT as DISAGREEMENT,
    JointFit as JointFit,
    joint_fit as joint_fit,
    steady_among as steady_among,
)
from .samples import BlockCollector as BlockCollector, Spring as Spring, load_lag as load_lag
from .steady_strokes import (
    SteadySpeed as SteadySpeed,
    Stroke as Stroke,
    steady_speeds as steady_speeds,
)
from .stiction import (
    StictionLevel as StictionLevel,
    Trend as Trend,
    stiction_level as stiction_level,
)
