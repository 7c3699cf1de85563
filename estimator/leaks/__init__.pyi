from .confirmation import CONFIRMED_AFTER_S as CONFIRMED_AFTER_S
from .decision import (
    ENCODER_DRIFT as ENCODER_DRIFT,
    SILENT as SILENT,
    Decision as Decision,
    is_of as is_of,
)
from .detection import (
    SETTLED_AFTER_S as SETTLED_AFTER_S,
    Detector as Detector,
    OilAccountDetector as OilAccountDetector,
    leak_flow as leak_flow,
)
from .fault_scores import (
    RIVAL_GAIN as RIVAL_GAIN,
    SETTLED_PART as SETTLED_PART,
    WITNESSES as WITNESSES,
    Candidates as Candidates,
    least_gain as least_gain,
)
from .fault_size import (
    GREAT_FLOW as GREAT_FLOW,
    SETTLING_BLOCKS as SETTLING_BLOCKS,
    FaultSizes as FaultSizes,
)
from .finding import Finding as Finding, Growth as Growth
from .found import Found as Found, found_in as found_in
from .leak_statistic import MINIMUM_BLOCKS as MINIMUM_BLOCKS, LeakTest as LeakTest
from .learnt_test import LearntLeakTest as LearntLeakTest
from .oil_account import OilAccount as OilAccount, Samples as Samples
from .pattern import (
    LEARNING_S as LEARNING_S,
    LEAST_LOOKS as LEAST_LOOKS,
    PATTERNS as PATTERNS,
    STARTED_S as STARTED_S,
    HealthyLevel as HealthyLevel,
    PatternBaseline as PatternBaseline,
    PatternDetector as PatternDetector,
    healthy_level as healthy_level,
    learn_pattern as learn_pattern,
    pattern_of as pattern_of,
)
from .replaying import (
    DetectorFactory as DetectorFactory,
    detector_for as detector_for,
    filter_recording as filter_recording,
    first_held as first_held,
    judged as judged,
    replay as replay,
    samples_of as samples_of,
)
from .supply_statistic import SIGNS as SIGNS, SUPPLY_SIGMA as SUPPLY_SIGMA, SupplyTest as SupplyTest
from .travel import travel_needed as travel_needed
