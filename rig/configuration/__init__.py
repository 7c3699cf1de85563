"""Reads YAML with units into the objects of the layers below: rigs, models, campaigns.

Every mistake of a file is reported at once, with line, value, limit and remedy.
"""

from .problems import ConfigError, Problem

__all__ = ["ConfigError", "Problem"]
