from .friction_experiment import (
    FrictionExperiment as FrictionExperiment,
    experiment_figures as experiment_figures,
    revised_model as revised_model,
    run_friction_experiment as run_friction_experiment,
)
from .friction_plan import (
    break_away_campaign as break_away_campaign,
    places_of as places_of,
    sliding_campaign as sliding_campaign,
)
from .gap_closing import CHANNELS as CHANNELS, ROUNDS as ROUNDS, close_gap as close_gap
from .gap_motions import (
    CHECK as CHECK,
    EXPERIMENT_S as EXPERIMENT_S,
    FITTED as FITTED,
    HELD as HELD,
    motions_campaign as motions_campaign,
    room_of as room_of,
)
from .gap_results import (
    answer as answer,
    gap_figures as gap_figures,
    provenance_of as provenance_of,
    rig_plant as rig_plant,
)
from .parts import (
    ExperimentStoppedError as ExperimentStoppedError,
    connected_parts as connected_parts,
    part_campaign as part_campaign,
    stroke_of as stroke_of,
)
from .tuning import (
    Response as Response,
    Tuning as Tuning,
    exciting_campaign as exciting_campaign,
    hold_campaign as hold_campaign,
    response_campaign as response_campaign,
    run_tuning as run_tuning,
    tuning_figures as tuning_figures,
)
from .worker_process import ApartError as ApartError, apart as apart
