from .actuator import servo_actuator as servo_actuator
