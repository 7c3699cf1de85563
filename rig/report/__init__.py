"""Turns results into HTML pages that need no other file: of campaigns, gaps, sweeps and friction.

It only reads results and recordings; it runs no test.
"""

from rig.report.campaign import render, write_report

__all__ = ["render", "write_report"]
