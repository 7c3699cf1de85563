"""Drive a servo-hydraulic actuator test rig: plant, drivers, loop, campaigns, recordings, reports.

Filters live in `estimator`, controllers in `control`, leak models and verdicts in `faults`.
"""

__version__ = "0.1.0"
