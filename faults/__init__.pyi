from .bypass import BypassValve as BypassValve
from .campaign import (
    Campaign as Campaign,
    CampaignTest as CampaignTest,
    Condition as Condition,
    ControlFrom as ControlFrom,
    LeakTestStep as LeakTestStep,
    OnFault as OnFault,
    SegmentEnd as SegmentEnd,
    SpringLoad as SpringLoad,
    Until as Until,
    WhenUnmet as WhenUnmet,
)
from .criteria import (
    DECIDED_FIGURES as DECIDED_FIGURES,
    FOLLOWING_ERROR as FOLLOWING_ERROR,
    FRICTION as FRICTION,
    MEASURES as MEASURES,
    STEP_FIGURES as STEP_FIGURES,
    STEP_M as STEP_M,
    WATCHED_FIGURES as WATCHED_FIGURES,
    Criterion as Criterion,
    LimitAction as LimitAction,
    LimitBand as LimitBand,
    LimitEach as LimitEach,
    OwnFigure as OwnFigure,
    TestLimit as TestLimit,
)
from .expressions import Expression as Expression, ExpressionError as ExpressionError
from .leakage import (
    TYPICAL_PRESSURE as TYPICAL_PRESSURE,
    linear_flow as linear_flow,
    size_shown as size_shown,
    square_root_flow as square_root_flow,
    to_litres_per_minute as to_litres_per_minute,
)
from .needle import NeedleCharacteristic as NeedleCharacteristic
from .needle_calibration import (
    CalibratedPoint as CalibratedPoint,
    CalibrationError as CalibrationError,
    Estimate as Estimate,
    Measurement as Measurement,
    NeedleCalibration as NeedleCalibration,
    UnsettledError as UnsettledError,
    calibrated_needle as calibrated_needle,
    measured_coefficient as measured_coefficient,
    meter_zero as meter_zero,
)
from .schedule import Fault as Fault, FaultSchedule as FaultSchedule, linked as linked
from .stretches import has_step as has_step, stretches_of as stretches_of
from .verdict import FAULT_KINDS as FAULT_KINDS, LEAK_KINDS as LEAK_KINDS, Verdict as Verdict
