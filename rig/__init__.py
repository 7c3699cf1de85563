"""This package drives a servo-hydraulic actuator test rig, real or simulated.

It holds the plant, the drivers, the loop, campaigns, recordings and reports. The filters are in
`estimator`, the controllers in `control`, the leak models and the verdicts in `faults`.
"""

__version__ = "0.1.0"
