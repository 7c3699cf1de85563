"""Turns the results of a campaign into one self-contained HTML page.

Reads results and recordings only; runs nothing.
"""

from rig.report.campaign import render, write_report

__all__ = ["render", "write_report"]
