"""Trials of leaks that come and go, on two simulated rigs: the product's and the independent one.

`python -m tools.intermittent --help` tells how they are run.
"""
