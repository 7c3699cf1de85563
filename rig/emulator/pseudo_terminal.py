"""The far end of an emulated serial line: a pseudo-terminal with a stable name."""

import os
import tty
from contextlib import suppress
from pathlib import Path
from typing import Final

_UNPLUGGED: Final = -1
"""Stands for the descriptors of a line that is not plugged in."""


class LinkError(ValueError):
    """Raised for a path that cannot name a serial line; the command line shows `problems`."""

    def __init__(self, path: Path, state: str) -> None:
        super().__init__(f"{path}: {state}; give the path of a link that may be made or replaced")
        self.problems = (str(self),)


class PseudoTerminal:
    """A serial line whose near end is `path`, as `/dev/ttyUSB0` would be.

    It has no baud rate: bytes arrive at once.

    Args:
        path: symbolic link that is made or replaced; a program that opens it has the near end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # The near end stays open here too, so that a line without users is not a broken one.
        self._far = self._near = _UNPLUGGED

    def plug_in(self) -> None:
        """Make the line and its link; nothing happens if it is plugged in already.

        Raises:
            LinkError: the path is no link, or its folder cannot be written to.
        """
        if self._far != _UNPLUGGED:
            return
        self._far, self._near = os.openpty()
        try:
            tty.setraw(self._near)
            os.set_blocking(self._far, False)
            self._name(os.ttyname(self._near))
        except BaseException:
            self._close()
            raise

    def unplug(self) -> None:
        """Remove the line, as a pulled plug does; repeated calls do no harm."""
        if self._far != _UNPLUGGED:
            with suppress(OSError):
                self.path.unlink()
            self._close()

    def _close(self) -> None:
        for end in (self._far, self._near):
            os.close(end)
        self._far = self._near = _UNPLUGGED

    def fileno(self) -> int:
        """Return the descriptor of the far end.

        Raises:
            OSError: the line is unplugged.
        """
        if self._far == _UNPLUGGED:
            raise OSError("the line is unplugged")
        return self._far

    def write(self, data: bytes) -> None:
        """Send bytes; those that do not fit, because nobody reads, are lost as on a real line.

        All are lost while the line is unplugged.
        """
        if self._far != _UNPLUGGED:
            with suppress(BlockingIOError):
                os.write(self._far, data)

    def read(self) -> bytes:
        """Return bytes that have come in, up to 4096 of them, without waiting.

        The result is empty if there are none, or the line is unplugged.
        """
        if self._far == _UNPLUGGED:
            return b""
        try:
            return os.read(self._far, 4096)
        except BlockingIOError:
            return b""

    def _name(self, device: str) -> None:
        try:
            if self.path.is_symlink():
                self.path.unlink()
            self.path.symlink_to(device)
        except FileExistsError as error:
            raise LinkError(self.path, "is there, and is no link") from error
        except OSError as error:
            raise LinkError(self.path, f"cannot be made ({error.strerror})") from error
