"""Position control and setpoint generators of the rig.

Compiled where the loop needs it; setpoints are tables known before the run.
"""
