"""The live stream over Zenoh: its messages and keys, its access control, a sender and a client.

This package imports neither the loop, the plant nor the compiler, so that a console on another
machine needs only this package, numpy, msgpack and Zenoh. The process that publishes a rig's stream
is `rig.supervisor.processes.publisher`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
