"""Lets the tools that start runs be ended by signals, with all that they have started."""

import signal
from typing import Final

_TO_END: Final = (signal.SIGINT, signal.SIGHUP, signal.SIGTERM)


def end_by_signals() -> None:
    """Let each signal to end this process raise a KeyboardInterrupt, as Ctrl-C does.

    In the background, or under nohup, this process ignores some of them, and so would all processes
    that it starts.
    """
    for each in _TO_END:
        signal.signal(each, signal.default_int_handler)
