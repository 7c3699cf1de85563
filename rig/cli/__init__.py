"""The command line composes the parts and turns errors into messages and exit codes.

A command imports the packages that it runs only when it is called, so that `rig --help` is quick.
"""

from .application import main

__all__ = ["main"]
