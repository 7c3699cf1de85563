"""The live stream over Zenoh: its messages, its keys, who may read and command, and a client.

Nothing here knows the loop, the plant or the compiler: a console on another machine needs this
package, numpy, msgpack and Zenoh. The process that publishes is
`rig.supervisor.processes.publisher`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
