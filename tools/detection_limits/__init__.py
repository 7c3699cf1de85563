"""Compares the smallest leaks that detectors find with the Cramer-Rao bound on a leak's flow.

`python -m tools.detection_limits` computes both and writes them into docs/detection.md.
"""
