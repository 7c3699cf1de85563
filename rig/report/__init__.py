"""Turns the results of a campaign into one self-contained HTML page.

It only reads results and recordings; it runs no test.
"""

from rig.report.campaign import render, write_report

__all__ = ["render", "write_report"]
