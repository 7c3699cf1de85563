from .actuator import servo_actuator as servo_actuator
from .layout import addition_of as addition_of, term_of as term_of
