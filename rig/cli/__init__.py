"""The command line: composes the parts, turns errors into messages and exit codes.

Commands import what they run, so that `rig --help` stays quick.
"""

from .application import main

__all__ = ["main"]
