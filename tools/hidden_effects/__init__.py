"""Trials of the gap workflow on a simulated rig that shares no code with `rig.plant`.

Effects are hidden in the rig, and the gap workflow has to find them from recordings. The simulator
imports no physics from `rig`, `control`, `estimator` or `faults`: an error of the product's model
would otherwise be in the recordings too and could not be noticed.
"""

import os

# `rig gap` sets this before it loads numpy; trials that run in this process do the same.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
