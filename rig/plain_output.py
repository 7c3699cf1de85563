"""Shows control characters in texts instead of sending them to the terminal.

All that `rig` prints passes here, and all that the processes of a session print to its log, as
names, remarks and reasons come from files and the network. A terminal that gets control characters
clears its screen, goes back in a line, or takes a title, and other characters turn the order of a
line round. What libraries in other languages print by themselves does not pass here.
"""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, TextIO, cast

_OBEYED: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]"
)
"""Control characters (Unicode category Cc) but tabulator and newline, and those by which lines are
broken or their direction changes (Unicode Standard Annex 9, table 4; annex 14, class BK)."""


def shown(text: str) -> str:
    r"""Return a text with `\u001b` and the like in place of characters that a terminal obeys.

    This is how JSON writes them too, so that a line of JSON keeps its meaning.
    """
    return _OBEYED.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


class PlainOutput:
    """A text stream that passes what is written on by `shown`.

    Attributes:
        unfiltered: the stream to which it is passed on, for who writes colours and moves the cursor
            on purpose.
    """

    def __init__(self, unfiltered: TextIO) -> None:
        self.unfiltered = unfiltered

    def write(self, text: str) -> int:
        """Write a text; return the number of its characters."""
        self.unfiltered.write(shown(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of the stream."""
        return getattr(self.unfiltered, name)


def shown_line(text: str) -> str:
    r"""Return a text as one line of a log, which is shown plainly: newlines as `\u000a`."""
    return shown(text).replace("\n", r"\u000a")


def make_output_plain() -> None:
    """Let this process's standard output and error be plain from now on."""
    sys.stdout, sys.stderr = (
        cast(TextIO, PlainOutput(stream)) for stream in (sys.stdout, sys.stderr)
    )


@contextmanager
def plain_output() -> Iterator[None]:
    """Let the block's standard output and error be plain; binary output is left as it is."""
    before = sys.stdout, sys.stderr
    make_output_plain()
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
