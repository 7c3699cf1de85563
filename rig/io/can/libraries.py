"""python-can and cantools, imported without asammdf.

cantools imports python-can, and that imports asammdf where it is installed, to read and write MF4
files of CAN frames. Nothing here does; asammdf and its pandas take longer than all the rest of what
a process on a CAN bus begins with.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

__all__ = ["cantools", "python_can"]


@contextmanager
def _empty(name: str) -> Iterator[None]:
    """Let nothing be imported from a module meanwhile, as if it were not installed."""
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
