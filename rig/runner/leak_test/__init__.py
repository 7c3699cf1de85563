"""The active leak test: lock the cylinder at several pressures, and fit its leaks to what they do.

`lockable` is what the test asks of a rig, `simulated` gives that of a simulated rig, and
`connected` runs it on hardware. `sequence` moves valves and records the soaks, and `results` turns
what was found into figures and words.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
