"""python-can and cantools, imported without asammdf.

cantools imports python-can, which imports asammdf where that is installed, to read and write MF4
files of CAN frames. The rig uses no such files, and importing asammdf with its pandas takes longer
than all other imports of a process on a CAN bus.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

__all__ = ["cantools", "python_can"]


@contextmanager
def _empty(name: str) -> Iterator[None]:
    """Replace a module by an empty one in the `with` block, as if it were not installed."""
    there = sys.modules.get(name)
    sys.modules[name] = ModuleType(name)
    try:
        yield
    finally:
        del sys.modules[name]
        if there is not None:
            sys.modules[name] = there


with _empty("asammdf"):
    import can as python_can
    import cantools
