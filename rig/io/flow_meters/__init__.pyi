from .driver import FlowMeters as FlowMeters
from .lines import meter_line as meter_line
