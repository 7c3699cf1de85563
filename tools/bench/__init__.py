"""Benchmarks of the software; run all by `python -m tools.bench`, or one module alone."""
