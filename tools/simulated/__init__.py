"""Simulated rigs for studies, benchmarks and tests: drawn at random, run in lanes, recorded."""
