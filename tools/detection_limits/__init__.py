"""What limits detection: the Cramer-Rao bound on a leak's flow beside what detectors achieve.

`python -m tools.detection_limits` measures both and writes them into docs/detection.md.
"""
