"""Configurations are found by path, or by name in certain folders and among the shipped ones."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal, TypeVar

from .document import Located, Sources
from .problems import ConfigError, Place, Problem, display_path, nearest

T = TypeVar("T")
Kind = Literal[
    "model", "rig", "campaign", "map", "dbc", "stream", "schedule", "sweep", "transducer"
]

FOLDERS: Final[dict[Kind, str]] = {
    "model": "models",
    "rig": "rigs",
    "campaign": "campaigns",
    "schedule": "schedules",
    "sweep": "sweeps",
    "map": "maps",
    "dbc": "dbc",
    "stream": "stream",
    "transducer": "transducers",
}
SUFFIXES: Final = (".yaml", ".yml", ".dbc")


def shipped_config_dir() -> Path:
    """Return the folder of the shipped configurations, in the installed wheel or the checkout.

    Raises:
        FileNotFoundError: the installation is damaged.
    """
    here = Path(__file__).resolve()
    for folder in (here.parents[2] / "shipped_config", here.parents[3] / "config"):
        if (folder / "models" / "nominal.yaml").is_file():
            return folder
    raise FileNotFoundError(f"no shipped configurations beside {here.parents[2]}; reinstall")


def copy_shipped(destination: Path) -> list[Path]:
    """Copy the shipped configurations into a new or empty folder; return all files there, sorted.

    Raises:
        ConfigError: the folder is not empty, or cannot be written.
    """
    try:
        if destination.exists() and (not destination.is_dir() or any(destination.iterdir())):
            raise _refusal(destination, "is not empty", "give a new or empty folder")
        shutil.copytree(shipped_config_dir(), destination, dirs_exist_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise _refusal(destination, f"cannot be written: {reason}", "give another") from error
    return sorted(path for path in destination.rglob("*") if path.is_file())


def _refusal(path: Path, limit: str, remedy: str) -> ConfigError:
    return ConfigError([Problem(display_path(path), 0, 0, "folder", "", limit, remedy)])


def is_path(reference: str) -> bool:
    """Return whether a reference is a path: it has a separator or a configuration's suffix."""
    return "/" in reference or "\\" in reference or reference.endswith(SUFFIXES)


def reference_in(item: Located | None) -> str | None:
    """Return the name or path that a value gives; None if the value is no text and no number.

    A number counts as a name (`rig: 7`).
    """
    if item is None or isinstance(item.value, bool):
        return None
    return str(item.value) if isinstance(item.value, str | int | float) else None


def asked(kind: Kind, reference: str | Path, sources: Sources) -> Located:
    """Return a path or name that a user gives as a `Located`, which `resolve` takes.

    Its name in messages is the kind. Problems with it are recorded in `sources`.
    """
    return Located(str(reference), Place(Path(reference), 0, 0), kind, sources)


def resolve(kind: Kind, item: Located | None, base: Path | None = None) -> Path | None:
    """Return the file that a reference means; if there is none, add a problem and return None.

    A relative path counts from the folder `base`. A name, without suffix, is looked for in the
    folder of its kind (such as `rigs`) within `base`; if a file refers to it, in that folder beside
    `base` too (so that an edited copy made by `rig init` wins); in `base` itself unless that is a
    folder of one kind; and then among the shipped configurations. The first file found is returned,
    but never the referring file itself. If the value is no name or path, the result is None without
    a problem.

    Args:
        kind: kind of configuration that is wanted.
        item: the value that gives the path or name, in a file or `asked` for.
        base: folder from which a user's reference counts; None for a value in a file, which counts
            from the folder of its file.
    """
    reference = reference_in(item)
    if item is None or reference is None:
        return None
    folder = base or item.place.path.parent
    if is_path(reference):
        try:
            path = (folder / Path(reference).expanduser()).resolve()
            if path.is_file():
                return path
            limit = "is not a file" if path.exists() else "does not exist"
        except (OSError, ValueError, RuntimeError) as error:
            # The path has a name that is too long, a NUL or a loop of links, or "~" has no meaning.
            reason = (getattr(error, "strerror", None) or str(error)).lower()
            item.refuse(f"cannot be a path: {reason}", "give the path of a file", item.shown)
            return None
        item.refuse(limit, _alternatives(kind, path.stem, path.parent), reference)
        return None
    for each in _folders(kind, folder, beside=base is None):
        for suffix in SUFFIXES:
            with suppress(OSError, ValueError):  # a name that is too long, or has a NUL
                path = (each / f"{reference}{suffix}").resolve()
                if path.is_file() and path != item.place.path:
                    return path
    item.refuse(f"is not a known {kind}", _alternatives(kind, reference, folder), reference)
    return None


def read_in(kind: Kind, item: Located | None, read: Callable[[Located], T | None]) -> T | None:
    """Return what `read` makes of the configuration file that a value refers to.

    `read` gets the mapping in the file, and returns None if it cannot use that. The result is None
    then, and if there is no such file; the problems are recorded.
    """
    path = resolve(kind, item)
    root = item.sources.read_yaml(path) if item is not None else None
    return read(root) if root is not None else None


def load(
    kind: Kind, reference: str | Path, base: Path | None, read: Callable[[Located], T | None]
) -> T:
    """Return the object that a configuration describes, which is given by path or by name.

    Args:
        kind: kind of configuration.
        reference: its path or name.
        base: folder from which a relative path is resolved, and where a name is looked for before
            the shipped ones; the working directory if None.
        read: makes the object from the mapping in the file; if that cannot be used, it records the
            problems and returns None.

    Raises:
        ConfigError: lists every problem of the file and of all files it refers to.
    """
    sources = Sources()
    path = resolve(kind, asked(kind, reference, sources), base or Path.cwd())
    root = sources.read_yaml(path)
    return sources.finished(read(root) if root is not None else None)


def available(kind: Kind, base: Path | None = None) -> list[str]:
    """Return the names of a kind's configurations, sorted, without suffix.

    These are the shipped ones, and those in the kind's folder in `base` or beside it.
    """
    folders = [shipped_config_dir() / FOLDERS[kind]]
    folders += [base / FOLDERS[kind], base.parent / FOLDERS[kind]] if base else []
    files = (path for folder in folders for path in folder.glob("*"))
    return sorted({path.stem for path in files if path.suffix in SUFFIXES})


def _folders(kind: Kind, base: Path, beside: bool) -> list[Path]:
    folders = [base / FOLDERS[kind]]
    if beside:
        folders.append(base.parent / FOLDERS[kind])
    # In a folder of one kind, such as rigs/, a file of the wanted name may be of the wrong kind.
    if base.name not in FOLDERS.values():
        folders.append(base)
    return [*folders, shipped_config_dir() / FOLDERS[kind]]


def _alternatives(kind: Kind, stem: str, base: Path) -> str:
    names = available(kind, base)
    near = nearest(stem, names)
    listing = f"available {FOLDERS[kind]}: {', '.join(names)}; or give the path of a file"
    return f"did you mean {near}? ({listing})" if near else listing
