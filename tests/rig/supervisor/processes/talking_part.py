"""A process of a session that says news, for tests of what hears it; it need not load pytest."""

import sys
from collections.abc import Callable

from rig.supervisor.processes.child import News, child_ends


def unreadable() -> object:
    """Fail, as the unpickling of a foreign object does."""
    raise LookupError("no such class")


class Strange:
    """An object that can be sent, and not be read."""

    def __reduce__(self) -> tuple[Callable[[], object], tuple[()]]:
        return unreadable, ()


def main() -> None:
    """Be a process of the session: say news twice, something strange, and what was asked."""
    _, pipe = child_ends()
    for text in ("first", "second"):
        pipe.send(News(0, "part", text))
    asked = pipe.recv()
    print(asked, file=sys.stderr)
    pipe.send(Strange() if asked == "strange" else asked)
    pipe.send(pipe.recv())
    pipe.recv()
