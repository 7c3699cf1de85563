"""Compares the tolerant controller with proportional control, for docs/tolerant_control.md.

Run as `python -m tools.tolerant_control`.
"""
