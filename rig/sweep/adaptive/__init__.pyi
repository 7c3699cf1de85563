from .adaptive_study import power_curves as power_curves
from .batches import (
    AdaptiveDrawing as AdaptiveDrawing,
    flows_of as flows_of,
    next_span as next_span,
)
from .monotone import Crossing as Crossing, crossing as crossing, steps as steps
