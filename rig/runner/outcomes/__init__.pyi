from .awaiting import AwaitedEnd as AwaitedEnd, SegmentEnds as SegmentEnds
from .calibrations import (
    CalibrationUsed as CalibrationUsed,
    calibrations_applied as calibrations_applied,
    calibrations_recorded as calibrations_recorded,
    calibrations_used as calibrations_used,
)
from .figures import (
    Array as Array,
    Figure as Figure,
    figures_of as figures_of,
    litres_per_minute as litres_per_minute,
)
from .friction import (
    FrictionWatch as FrictionWatch,
    change_figures as change_figures,
    friction_figures as friction_figures,
    model_spring as model_spring,
)
from .in_words import (
    chance as chance,
    comes_and_goes as comes_and_goes,
    drifts as drifts,
    grows as grows,
    in_passing as in_passing,
    last_seen as last_seen,
    onset_shown as onset_shown,
    others_found as others_found,
    percent as percent,
    reaction as reaction,
)
from .limits import (
    LimitNotJudged as LimitNotJudged,
    LimitPassed as LimitPassed,
    LimitWatch as LimitWatch,
)
from .measures import (
    CriterionResult as CriterionResult,
    Measures as Measures,
    Rows as Rows,
    step_answers as step_answers,
)
from .observer import Observer as Observer
from .outcome import (
    EXIT_BAD_INPUT as EXIT_BAD_INPUT,
    EXIT_FAILED as EXIT_FAILED,
    EXIT_STOPPED as EXIT_STOPPED,
    Attempt as Attempt,
    CampaignOutcome as CampaignOutcome,
    ControlChanged as ControlChanged,
    Happening as Happening,
    InjectedFault as InjectedFault,
    Status as Status,
    TestOutcome as TestOutcome,
)
from .outcome_record import (
    jsonable as jsonable,
    named as named,
    outcome_of as outcome_of,
    record_of as record_of,
)
from .reactions import DecisionRows as DecisionRows, Reactions as Reactions
from .recorded import (
    account_detector_of as account_detector_of,
    assumed_parameters as assumed_parameters,
    detector_of as detector_of,
    metadata_of as metadata_of,
    sensors_of as sensors_of,
    spring_of as spring_of,
    with_estimates as with_estimates,
)
from .segments import SegmentRun as SegmentRun, segments_run as segments_run
from .software_state import git_state as git_state, provenance as provenance, versions as versions
from .thresholds import (
    HealthyInnovations as HealthyInnovations,
    HealthyReferences as HealthyReferences,
)
from .timeline import Timeline as Timeline
