"""A servo-hydraulic rig that shares no code with `rig.plant`, with effects to hide in it.

Recordings made here judge the gap workflow: nothing in `rig`, `control`, `estimator` or `faults` is
imported by the simulator, so that an error of the model cannot hide itself.
"""
