from .campaigns import (
    Entry as Entry,
    Missed as Missed,
    Schedule as Schedule,
    load_campaign as load_campaign,
    load_schedule as load_schedule,
    plain as plain,
    plan_campaign as plan_campaign,
    valve_speed as valve_speed,
)
from .checking import check as check
from .editing import EDITED as EDITED, editor_schema as editor_schema
from .models import (
    PlantModel as PlantModel,
    dump_model as dump_model,
    load_columns as load_columns,
    load_model as load_model,
    load_plant as load_plant,
)
from .reading import (
    ConfigError as ConfigError,
    Located as Located,
    Physical as Physical,
    Place as Place,
    Problem as Problem,
    QuantityError as QuantityError,
    Schema as Schema,
    Sources as Sources,
    copy_shipped as copy_shipped,
    elements_of as elements_of,
    read_mapping as read_mapping,
    read_options as read_options,
    shipped_config_dir as shipped_config_dir,
    show as show,
    suggestion as suggestion,
)
from .rigs import (
    DEFAULT as DEFAULT,
    OFF as OFF,
    Rig as Rig,
    control_in_words as control_in_words,
    control_lines as control_lines,
    dump_calibration as dump_calibration,
    find_rig as find_rig,
    load_rig as load_rig,
    load_stream as load_stream,
    load_tolerances as load_tolerances,
    margins_by_model as margins_by_model,
    margins_in_words as margins_in_words,
    ordered_control as ordered_control,
    with_control as with_control,
)
from .sweeps import (
    HEALTHY as HEALTHY,
    Distribution as Distribution,
    Sweep as Sweep,
    SweepFilter as SweepFilter,
    SweptMotion as SweptMotion,
    load_sweep as load_sweep,
)
