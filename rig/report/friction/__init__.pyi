from .experiment import (
    experiment_page as experiment_page,
    parameter_rows as parameter_rows,
    remarks as remarks,
)
from .page import (
    FrictionRun as FrictionRun,
    changes_in_words as changes_in_words,
    friction as friction,
    friction_page as friction_page,
    in_words as in_words,
    needs_in_words as needs_in_words,
    shown as shown,
)
