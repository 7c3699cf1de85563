from .bands import unheard as unheard
from .block_sums import BlockSums as BlockSums, weights_of as weights_of
from .costly_stretches import Excerpt as Excerpt, excerpts as excerpts
from .fit import Changes as Changes, Filtered as Filtered, Fitted as Fitted, Fitter as Fitter
from .held_out import channel_gaps as channel_gaps, free_runs as free_runs, mean_gap as mean_gap
from .linear import (
    HUBER as HUBER,
    Column as Column,
    Linear as Linear,
    assemble as assemble,
    bounded_least_squares as bounded_least_squares,
    cost_of as cost_of,
    mean_squares as mean_squares,
    settling as settling,
    slices_of as slices_of,
    standard_errors as standard_errors,
)
from .predictor import Predictor as Predictor
from .results import (
    Band as Band,
    ChannelGap as ChannelGap,
    Check as Check,
    Curve as Curve,
    DetectionLimit as DetectionLimit,
    Discovered as Discovered,
    Estimate as Estimate,
    FreeRun as FreeRun,
    GapResult as GapResult,
    NamedEffect as NamedEffect,
    Rival as Rival,
    Round as Round,
    Separation as Separation,
    Verdict as Verdict,
)
from .sensitivities import Course as Course, course_of as course_of
from .suitability import (
    check_course as check_course,
    unsuitable as unsuitable,
    usable as usable,
    worse_than_resting as worse_than_resting,
)
from .variables import (
    Values as Values,
    Variable as Variable,
    effect_variables as effect_variables,
    freed as freed,
    nuisance_variable as nuisance_variable,
    started as started,
    with_effect_of as with_effect_of,
)
