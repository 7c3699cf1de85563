"""Runs the thesis's tests on the simulated rig and sets its printed figures beside the computed.

`python -m tools.thesis_tables` writes `docs/thesis_tables.md`; the same seeds give the same page.
"""
