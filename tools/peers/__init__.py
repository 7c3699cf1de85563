"""Compares `rig gap` with other methods on the same recordings, fitted and held out alike.

The others are a sparse regression of the model's errors (PySINDy) and a Gaussian process on them
(scikit-learn). docs/peers.md says how, and holds the tables.
"""
