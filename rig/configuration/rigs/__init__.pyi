from .blocking import BlockingValves as BlockingValves
from .calibrated import (
    calibration_warnings as calibration_warnings,
    corrected_twice as corrected_twice,
)
from .calibration_file import dump_calibration as dump_calibration
from .control import (
    UNLESS_USUAL as UNLESS_USUAL,
    control_lines as control_lines,
    read_control as read_control,
    with_control as with_control,
)
from .control_orders import (
    control_in_words as control_in_words,
    margins_by_model as margins_by_model,
    margins_in_words as margins_in_words,
    ordered_control as ordered_control,
    remedy_of_margins as remedy_of_margins,
)
from .hardware import valves_of as valves_of
from .limits import (
    Limits as Limits,
    as_shown as as_shown,
    limit_schema as limit_schema,
    read_channel_limits as read_channel_limits,
)
from .register_maps import MAPS as MAPS, Map as Map, read_dbc as read_dbc, read_map as read_map
from .rewriting import NotAsMeantError as NotAsMeantError, rewrite_rig as rewrite_rig
from .rig import (
    GAIN as GAIN,
    Rig as Rig,
    RigFile as RigFile,
    find_rig as find_rig,
    load_rig as load_rig,
    read_rig as read_rig,
)
from .stream import (
    DEFAULT as DEFAULT,
    OFF as OFF,
    StreamFile as StreamFile,
    load_stream as load_stream,
    read_stream as read_stream,
    stream_lines as stream_lines,
)
from .tolerances import load_tolerances as load_tolerances
from .transducers import (
    SOON as SOON,
    TransducerFile as TransducerFile,
    read_transducer as read_transducer,
    transducer_lines as transducer_lines,
)
from .valves import LEAKAGE as LEAKAGE, RESISTANCE as RESISTANCE
from .wiring import read_wiring as read_wiring, wiring_lines as wiring_lines
from .writing import with_section as with_section, with_values as with_values
