from .product_lanes import ProductLanes as ProductLanes
from .product_noise import DRY as DRY, ProductNoise as ProductNoise
from .readings import settled_return as settled_return, settled_supply as settled_supply
from .registry import (
    DEFAULT_FILTER as DEFAULT_FILTER,
    FILTERS as FILTERS,
    OUTPUTS as OUTPUTS,
    FilterMemory as FilterMemory,
    FilterRun as FilterRun,
    compiled_filter as compiled_filter,
    filter_named as filter_named,
    filter_start as filter_start,
    filter_step as filter_step,
    run_filter as run_filter,
    start_memory as start_memory,
)
from .residuals import (
    THESIS_WINDOW as THESIS_WINDOW,
    extend_moving_average as extend_moving_average,
    moving_average_absolute as moving_average_absolute,
    start_moving_average as start_moving_average,
)
from .thesis import initial_state as initial_state, thesis7_step as thesis7_step
