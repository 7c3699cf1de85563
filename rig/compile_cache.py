"""Compiled code is cached between runs in one folder for each state of the sources.

numba only notices a change of a function's own file, not of the physics that the function calls,
and would go on running code that was compiled from older equations. A cache that is keyed by all
compiled sources cannot be out of date. The key covers drivers of other packages too, as the loop
compiles the exchange of a fast driver into its own code.
"""

import errno
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

DRIVERS: Final = "hydraulic_rig.drivers"
"""Name of the group of entry points by which packages announce their driver classes."""

COMPILED_ONCE: Final = "once for each version of the program"
"""How often a program that compiles for this machine does so, in words for the operator."""
_COMPILED: Final = (
    "rig/channels.py",
    "rig/jit.py",
    "rig/lanes",
    "rig/plant",
    "rig/io",
    "rig/loop",
    "rig/emulator",
    "rig/sweep",
    "control",
    "estimator",
)
_KEPT: Final = 12
"""Number of folders that are kept when a new one is made, the last used ones.

Other checkouts of the software have their folders in the same place.
"""


def cache_home() -> Path:
    """Return the user's cache directory: XDG_CACHE_HOME, else ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def source_key(root: Path) -> str:
    """Return a digest, 16 hex digits, of Python's version and all sources that may be compiled.

    `root` is the folder that holds the packages `rig`, `control` and `estimator`.
    """
    digest = sha256(sys.version.encode())
    for package in _COMPILED:
        here = root / package
        for path in [here] if here.is_file() else sorted(here.rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def drivers_key() -> str:
    """Return a digest, 16 hex digits, of other packages that announce drivers, with their sources.

    It is "" if there are none. numba cannot read code that it cached for a driver whose package is
    not installed any more.
    """
    modules = (entry.value.partition(":")[0] for entry in entry_points(group=DRIVERS))
    packages = sorted({module.partition(".")[0] for module in modules} - {"rig"})
    digest = sha256()
    for package in packages:
        digest.update(package.encode())
        for path in _sources_of(package):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16] if packages else ""


def _sources_of(package: str) -> list[Path]:
    """Return the source files of a package or module without importing it; [] if it is broken."""
    # A broken driver is reported when a rig asks for it.
    with suppress(ImportError, ValueError):
        spec = find_spec(package)
        if spec is not None and spec.submodule_search_locations is not None:
            folders = (Path(folder) for folder in spec.submodule_search_locations)
            return [path for folder in folders for path in sorted(folder.rglob("*.py"))]
        if spec is not None and spec.has_location:
            return [Path(str(spec.origin))]
    return []


def use_compile_cache() -> None:
    """Make numba use the cache folder of the present sources, unless NUMBA_CACHE_DIR is set.

    NUMBA_CACHE_DIR is set to the folder, which is in the user's cache directory (XDG_CACHE_HOME,
    else ~/.cache) and is made if missing. Where that may not be written to, it is in a folder of
    this user's own in the system's folder for temporary files; where not even there, numba chooses
    by itself. When it is made, only the 12 folders that were used last are kept.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    name = "-".join(filter(None, (source_key(Path(__file__).parents[1]), drivers_key())))
    folder = None
    for home in (lambda: cache_home() / "hydraulic-rig", _own_temporary_folder):
        with suppress(OSError):
            folder = _writable_folder(home(), name)
            break
    if folder is None:
        return
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _writable_folder(home: Path, name: str) -> Path:
    """Return a folder in `home`, which is made if missing, as the one that was used last.

    Raises:
        OSError: it cannot be made, or not be written to.
    """
    folder = home / name
    if folder.is_dir():
        os.utime(folder)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, "may not be written to", str(folder))
    else:
        folder.mkdir(parents=True)
        _drop_old(home)
    return folder


def _own_temporary_folder() -> Path:
    """Return a folder for temporary files that nobody but this user may write to.

    What is cached is run. So a folder that somebody else has put there is not taken.

    Raises:
        OSError: there is none, and none can be made.
    """
    folder = Path(tempfile.gettempdir()) / f"hydraulic-rig-{os.getuid()}"
    folder.mkdir(mode=stat.S_IRWXU, exist_ok=True)
    state = folder.lstat()
    others = stat.S_IRWXG | stat.S_IRWXO
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & others:
        raise PermissionError(errno.EACCES, "is not this user's alone", str(folder))
    return folder


def marks_folder() -> Path | None:
    """Return the folder for files that mark what is compiled; None if there is no cache folder.

    Each processor type, each version of numba and each place of the software on the disk has
    another folder, as numba compiles anew for each of them. The folder is made if missing.
    """
    use_compile_cache()
    folder = os.environ.get("NUMBA_CACHE_DIR")
    if not folder:
        return None
    import llvmlite
    import numba
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    software = Path(__file__).parents[1]
    made_from = str(software), source_key(software), drivers_key()
    made_by = numba.__version__, llvmlite.__version__
    made_for = get_host_cpu_name(), get_host_cpu_features().flatten()
    name = sha256("\n".join((*made_from, *made_by, *made_for)).encode()).hexdigest()[:16]
    marks = Path(folder) / "compiled" / name
    try:
        marks.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return marks


@contextmanager
def telling_of_compiling(
    tell: Callable[[str], None], is_done: Callable[[], None] = lambda: None
) -> Iterator[None]:
    """Call `tell` with the full name of each function just before numba compiles it in the block.

    `tell` is not called for functions that are loaded from the cache, nor for functions that are
    compiled as part of another one.

    Args:
        tell: takes the name; it is called from the thread that compiles.
        is_done: is called from there once that function is compiled, or could not be.
    """
    from numba.core import event

    class Listener(event.Listener):
        def __init__(self) -> None:
            self._depth = 0

        def on_start(self, event: Any) -> None:
            self._depth += 1
            if self._depth == 1:
                function = event.data["dispatcher"].py_func
                tell(f"{function.__module__}.{function.__qualname__}")

        def on_end(self, event: Any) -> None:
            self._depth -= 1
            if self._depth == 0:
                is_done()

    with event.install_listener("numba:compile", Listener()):
        yield


def _drop_old(home: Path) -> None:
    folders = sorted(home.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for folder in folders[_KEPT:]:
        with suppress(OSError):
            shutil.rmtree(folder)
