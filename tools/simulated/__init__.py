"""Simulated rigs for studies, benchmarks and tests: drawn at random, side by side, recorded."""
