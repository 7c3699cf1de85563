"""Runs the thesis's tests on the simulated rig, and compares their figures with the printed ones.

`python -m tools.thesis_tables` writes `docs/thesis_tables.md`; the same seeds give the same page.
"""
