"""Filters, residuals, leak detection and isolation, and replay over recordings.

The thesis filters are references by name; the default detector is our own.
"""
