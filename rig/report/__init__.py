"""Turns the results of a campaign into one self-contained HTML page.

Reads results and recordings only; runs nothing.
"""
