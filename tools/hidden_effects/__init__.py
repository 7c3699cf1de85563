"""Trials of the gap workflow on a simulated rig that shares no code with `rig.plant`.

Effects are hidden in the rig, and the gap workflow has to find them from recordings. The simulator
imports no physics from `rig`, `control`, `estimator` or `faults`: an error of the product's model
would otherwise be in the recordings too and could not be noticed.
"""
