"""Leaks as injected: bypass valves, fault schedules, campaigns of tests and their verdicts.

Coefficients are SI; every injected leak is recorded as ground truth.
"""
