from .control_port import ControlPort as ControlPort
from .fault_script import (
    ATTENTIVE as ATTENTIVE,
    NOTHING as NOTHING,
    Script as Script,
    fault_from as fault_from,
    read_script as read_script,
)
from .injection import Injection as Injection
