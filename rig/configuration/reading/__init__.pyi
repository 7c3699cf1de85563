from .document import Located as Located, Sources as Sources
from .fields import (
    Adjustable as Adjustable,
    Field as Field,
    Interval as Interval,
    Physical as Physical,
    Relative as Relative,
)
from .lookup import (
    FOLDERS as FOLDERS,
    Kind as Kind,
    available as available,
    copy_shipped as copy_shipped,
    is_path as is_path,
    load as load,
    reference_in as reference_in,
    resolve as resolve,
    resolve_in as resolve_in,
    shipped_config_dir as shipped_config_dir,
)
from .matrix import expand as expand
from .options import options_of as options_of, read_options as read_options
from .problems import (
    ConfigError as ConfigError,
    Place as Place,
    Problem as Problem,
    Problems as Problems,
    display_path as display_path,
    suggestion as suggestion,
)
from .quantities import (
    QuantityError as QuantityError,
    WrongDimensionError as WrongDimensionError,
    read as read,
    show as show,
    unit_factor as unit_factor,
)
from .validation import (
    LONGEST_VALUE as LONGEST_VALUE,
    Schema as Schema,
    elements_of as elements_of,
    quantity_in as quantity_in,
    read_mapping as read_mapping,
    shown as shown,
)
