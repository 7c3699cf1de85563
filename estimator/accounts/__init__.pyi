from .block_noise import (
    MOST_LASTING as MOST_LASTING,
    RecentBlocks as RecentBlocks,
    lasting_noise as lasting_noise,
)
from .crossings import (
    between as between,
    noise_limit as noise_limit,
    student_quantile as student_quantile,
)
from .fit_sums import compile_fits as compile_fits, normal_equations as normal_equations
from .flow import (
    BLOCK_S as BLOCK_S,
    BLOCK_TICKS as BLOCK_TICKS,
    FROZEN_SAMPLES as FROZEN_SAMPLES,
    AccountBlock as AccountBlock,
    FlowAccount as FlowAccount,
    reference_drop as reference_drop,
    reference_flow as reference_flow,
)
from .joint_fit import (
    MOST_LEVERAGE as MOST_LEVERAGE,
    JointFit as JointFit,
    Stretch as Stretch,
    around as around,
)
from .lane_account import LaneAccounts as LaneAccounts
from .noise import (
    DEAD_ZONE as DEAD_ZONE,
    MODEL_NOISE as MODEL_NOISE,
    MOST_MODEL_ERROR as MOST_MODEL_ERROR,
    OWN_NOISE as OWN_NOISE,
    RELATIVE_DEAD_ZONE as RELATIVE_DEAD_ZONE,
    SENSOR_PARTS as SENSOR_PARTS,
    SENSOR_PLACES as SENSOR_PLACES,
    checked_model_error as checked_model_error,
    dead_zones as dead_zones,
    sensor_noise as sensor_noise,
    spool_flow as spool_flow,
    whitening as whitening,
)
from .nuisances import (
    DRIFT as DRIFT,
    NUISANCE_COUNT as NUISANCE_COUNT,
    NUISANCES as NUISANCES,
    NULL_SHIFT as NULL_SHIFT,
    UNINFORMED as UNINFORMED,
    NuisanceBelief as NuisanceBelief,
    nuisance_index as nuisance_index,
)
from .ramp_search import (
    LikelyRamp as LikelyRamp,
    RampRules as RampRules,
    compile_ramp_search as compile_ramp_search,
    last_mark as last_mark,
    likeliest_ramp as likeliest_ramp,
)
from .ramps import Intervals as Intervals, Ramp as Ramp, RampFit as RampFit
from .regression import (
    LEAST_INFORMATION as LEAST_INFORMATION,
    NOISE_WEIGHT as NOISE_WEIGHT,
    Regression as Regression,
    Scores as Scores,
    least_variance as least_variance,
)
from .row import (
    FAULT_COUNT as FAULT_COUNT,
    INTERNAL_LEAKAGE as INTERNAL_LEAKAGE,
    SUPPLY_LEAKAGE as SUPPLY_LEAKAGE,
)
from .sums import (
    SHIFT as SHIFT,
    AccountSums as AccountSums,
    FaultProducts as FaultProducts,
    Places as Places,
)
