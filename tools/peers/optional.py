"""Imports the packages of the extra `peers`, which nothing else of this project needs."""

from importlib import import_module
from typing import Any


class MissingPeerError(ImportError):
    """A package of the extra `peers` is not installed; the message says how to install it."""


def needed(module: str, package: str = "") -> Any:
    """Return a module of the extra `peers`.

    Args:
        module: its name.
        package: name of the package that has it, if it is another.

    Raises:
        MissingPeerError: it is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise MissingPeerError(
            f"{package or module} is not installed ({error}); the comparison needs the extra "
            "peers: pip install -e .[peers]"
        ) from error
