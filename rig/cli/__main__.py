"""This module makes `python -m rig.cli` the same as the command `rig`."""

from .application import main

main()
