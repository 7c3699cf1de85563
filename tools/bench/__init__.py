"""How fast it is: `python -m tools.bench`, or one of the modules alone."""
