from .actuator import servo_actuator as servo_actuator
from .layout import (
    addition_of as addition_of,
    as_addition as as_addition,
    as_term as as_term,
    term_of as term_of,
)
