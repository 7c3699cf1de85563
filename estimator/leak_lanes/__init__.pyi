from .compiled_tests import CompiledDetector as CompiledDetector, load_compiled as load_compiled
from .lane_detectors import LaneDetectors as LaneDetectors
