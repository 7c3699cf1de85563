from .asked_columns import (
    asked_column as asked_column,
    figures_judged_twice as figures_judged_twice,
    limit_label as limit_label,
    met_column as met_column,
)
from .distributions import Distribution as Distribution
from .sweep import (
    SweepFile as SweepFile,
    load_sweep as load_sweep,
    read_sweep as read_sweep,
    sweep_lines as sweep_lines,
)
from .sweep_plan import (
    HEALTHY as HEALTHY,
    LATENCY as LATENCY,
    AdaptiveSizes as AdaptiveSizes,
    Sweep as Sweep,
    SweepFilter as SweepFilter,
    SweptLeaks as SweptLeaks,
    SweptMotion as SweptMotion,
)
