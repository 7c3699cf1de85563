"""Benchmarks of the software, each a module; `python -m tools.bench` runs the quick four."""
