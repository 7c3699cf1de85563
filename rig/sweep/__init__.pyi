from .adaptive import power_curves as power_curves
from .asked_study import (
    AskedStudy as AskedStudy,
    CriterionStudy as CriterionStudy,
    FigureStudy as FigureStudy,
    LimitStudy as LimitStudy,
    study_of_asked as study_of_asked,
)
from .cluster import (
    ClusterError as ClusterError,
    connected as connected,
    run_cluster as run_cluster,
)
from .folder import (
    PAGE as PAGE,
    SUMMARY as SUMMARY,
    TABLE as TABLE,
    SweepFolder as SweepFolder,
    read_identity as read_identity,
    unfinished_folder as unfinished_folder,
)
from .group import SweepError as SweepError
from .local import run_here as run_here, run_pool as run_pool
from .running import (
    Runner as Runner,
    Timing as Timing,
    chunks_of as chunks_of,
    is_complete as is_complete,
    run_sweep as run_sweep,
)
from .study import (
    LEAST_CASES as LEAST_CASES,
    POWER as POWER,
    PowerCurve as PowerCurve,
    Roc as Roc,
    Share as Share,
    Study as Study,
    power_curve as power_curve,
    study_of as study_of,
    verdict_order as verdict_order,
)
from .table import columns_of as columns_of, unit_of as unit_of
