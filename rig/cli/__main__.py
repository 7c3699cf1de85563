"""Lets `python -m rig.cli` do what `rig` does."""

from .application import main

main()
