"""Keeps the files of a run whose folder is removed or moved while it runs.

A file that is removed stays on the disk as long as a process has it open. So all files of the run
are held open here, and are copied to another folder once that of the run is gone.
"""

import os
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from rig.surviving import Surviving, start

from .directory import first_free
from .journal import JOURNAL, sync

LOOK_S: Final = 0.25
"""Period in s of looking whether the folder is there: a quarter of the second within which an
operator is to be told, as the thread may be late on a busy machine."""
MOST_HELD: Final = 250
"""Most files that are held open; a process may have 1024, and a run needs some hundred others."""
KEPT: Final = "-kept"
"""What is added to the folder's name for the one to which its files are copied."""
_PIECE: Final = 1 << 20


@dataclass
class _Held:
    """A file of the run, by its name in the folder and a descriptor that keeps it on the disk.

    `copied` says how many bytes of it were copied to another folder.
    """

    name: str
    descriptor: int
    copied: int = 0


class FolderKeeper:
    """A context manager that looks after the folder of a run, in a thread of its own.

    Args:
        folder: the folder, which has a journal.
        gone: is called once, from any thread, when the folder is not there any more, or its journal
            is not, or is another one.
        kept: is called with the new folder when the files have been copied to it.
        tell: shows a line to the operator; it is called from any thread.

    Attributes:
        kept_in: the folder to which the files were copied; None if they were not.
    """

    def __init__(
        self,
        folder: Path,
        gone: Callable[[], None],
        kept: Callable[[Path], None],
        tell: Callable[[str], None],
    ) -> None:
        self.kept_in: Path | None = None
        self._is_gone = False
        self._journal = 0
        """Inode of the journal, which a run only adds to."""
        self._folder = folder
        self._gone, self._kept, self._tell = gone, kept, tell
        self._held: dict[int, _Held] = {}
        self._let_go: set[int] = set()
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._survives = Surviving("looking after the run's folder", tell)
        self._thread = threading.Thread(target=self._run, name="folder", daemon=True)

    def __enter__(self) -> "FolderKeeper":
        self._itself = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            self.look()
            start(self._thread)
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        if self.kept_in is not None:
            # A file that another process writes, such as a session's log, has grown meanwhile.
            with suppress(OSError):
                self._copy_to(self.kept_in, only_grown=True)
        self._close()

    def _close(self) -> None:
        for held in self._held.values():
            os.close(held.descriptor)
        os.close(self._itself)

    def _run(self) -> None:
        while not self._ending.wait(LOOK_S) and not self._is_gone:
            with self._survives:
                self.look()

    @property
    def folder(self) -> Path:
        """The run's folder or, once that is gone, the one to which its files are copied then.

        The main thread asks for it, while no recording is being written.

        Raises:
            OSError: the files can be copied nowhere; the message says why.
        """
        if self.kept_in is None and not self.look():
            self.kept_in = self._land()
            self._tell(
                f"what the run wrote is kept in {self.kept_in}; go on with it: "
                f"rig run --resume {self.kept_in}"
            )
            self._kept(self.kept_in)
        return self.kept_in or self._folder

    def look(self) -> bool:
        """Return whether the folder is there; take hold of the files that are new in it.

        The function may be called from any thread, and takes a millisecond for 1000 files.
        """
        with self._lock:
            if self._is_gone:
                return False
            itself = os.fstat(self._itself)
            try:
                now = os.stat(self._folder)
                journal = (self._folder / JOURNAL).stat().st_ino
                self._journal = self._journal or journal
                same = (now.st_dev, now.st_ino) == (itself.st_dev, itself.st_ino)
                same = same and journal == self._journal
                if same:
                    self._take_hold()
            except (FileNotFoundError, NotADirectoryError):
                same = False
            self._is_gone = not same
        if not same:
            self._tell(
                f"the run's folder {self._folder} was removed, moved or emptied; the run stops"
            )
            self._gone()
        return same

    def _take_hold(self) -> None:
        """Open the files of the folder that are not held yet; close those that were replaced."""
        names = {}
        with os.scandir(self._itself) as entries:
            for entry in entries:
                # A name with a point in front is that of a file that is not complete yet.
                if entry.is_file(follow_symlinks=False) and not entry.name.startswith("."):
                    names[entry.name] = entry.inode()
        for inode, held in list(self._held.items()):
            if names.get(held.name, inode) != inode:
                os.close(self._held.pop(inode).descriptor)
        self._let_go &= set(names.values())
        for name, inode in names.items():
            if inode in self._held:
                self._held[inode].name = name
                continue
            if inode in self._let_go:
                continue
            # It may have been removed since the folder was read.
            with suppress(FileNotFoundError):
                descriptor = os.open(name, os.O_RDONLY | os.O_CLOEXEC, dir_fd=self._itself)
                self._held[os.fstat(descriptor).st_ino] = _Held(name, descriptor)
        # The journal is written anew by who writes it, so that it need not be held either.
        while len(self._held) > MOST_HELD:
            oldest = next(iter(self._held))
            os.close(self._held.pop(oldest).descriptor)
            self._let_go.add(oldest)

    def _land(self) -> Path:
        """Copy all files that are held to a new folder, and return that.

        It is beside the run's folder, with `KEPT` added to its name; where that cannot be made or
        filled, it is in the system's temporary folder, or else in the working directory.

        Raises:
            OSError: none of these folders can be written to; the message says why.
        """
        reasons = []
        for parent in (self._folder.absolute().parent, Path(tempfile.gettempdir()), Path.cwd()):
            name = first_free(f"{self._folder.name}{KEPT}", partial(_is_in, parent))
            try:
                (parent / name).mkdir(parents=True)
                self._copy_to(parent / name)
                return parent / name
            except OSError as error:
                reasons.append(f"{parent / name}: {error.strerror or error}")
        raise OSError(f"it is gone, and its files cannot be kept: {'; '.join(reasons)}")

    def _copy_to(self, folder: Path, *, only_grown: bool = False) -> None:
        for held in self._held.values():
            if only_grown and os.fstat(held.descriptor).st_size == held.copied:
                continue
            held.copied = 0
            with (folder / held.name).open("wb") as copy:
                while piece := os.pread(held.descriptor, _PIECE, held.copied):
                    copy.write(piece)
                    held.copied += len(piece)
                copy.flush()
                os.fsync(copy.fileno())
        sync(folder)


def _is_in(folder: Path, name: str) -> bool:
    return (folder / name).exists()
