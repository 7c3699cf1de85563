from .document import (
    LONGEST_NUMBER as LONGEST_NUMBER,
    LONGEST_VALUE as LONGEST_VALUE,
    Located as Located,
    Sources as Sources,
)
from .fields import (
    Adjustable as Adjustable,
    AnyQuantity as AnyQuantity,
    Field as Field,
    Interval as Interval,
    Is as Is,
    Name as Name,
    Physical as Physical,
    Relative as Relative,
    Written as Written,
    check_name as check_name,
)
from .lookup import (
    FOLDERS as FOLDERS,
    Kind as Kind,
    asked as asked,
    available as available,
    copy_shipped as copy_shipped,
    is_path as is_path,
    load as load,
    read_in as read_in,
    reference_in as reference_in,
    resolve as resolve,
    shipped_config_dir as shipped_config_dir,
)
from .matrix import MAX_TESTS as MAX_TESTS, expand as expand
from .options import (
    options_of as options_of,
    options_schema as options_schema,
    read_options as read_options,
)
from .problems import (
    ConfigError as ConfigError,
    Place as Place,
    Problem as Problem,
    display_path as display_path,
    suggestion as suggestion,
)
from .quantities import (
    DIMENSIONS as DIMENSIONS,
    QuantityError as QuantityError,
    WrongDimensionError as WrongDimensionError,
    read as read,
    show as show,
    show_alike as show_alike,
    unit_factor as unit_factor,
)
from .unit_patterns import known_units as known_units, quantity_pattern as quantity_pattern
from .validation import (
    Schema as Schema,
    Under as Under,
    checked as checked,
    elements_of as elements_of,
    quantity_in as quantity_in,
    read_mapping as read_mapping,
    refuse_missing as refuse_missing,
)
