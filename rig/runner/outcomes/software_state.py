"""Collects what a result depends on: software versions, git state, model, and files read."""

import platform
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import rig
from faults import Campaign
from rig.plant import model_sha256

_PACKAGES: Final = ("numpy", "numba", "mcap")
_GIT_TIMEOUT_S: Final = 5.0


def provenance(campaign: Campaign, command: Sequence[str] = ()) -> dict[str, Any]:
    """Return the versions, git state and hashes that a campaign's results depend on, JSON-able.

    Args:
        campaign: the campaign.
        command: the command line that runs the campaign; if empty, the key `command` is left out.
    """
    known = {"command": list(command)} if command else {}
    return known | {
        "versions": versions(),
        "git": git_state(Path(rig.__file__).parent),
        "model_sha256": model_sha256(campaign.model),
        "source_files": dict(campaign.source_files),
    }


def versions() -> dict[str, str]:
    """Return by name the versions of this package, Python, and the libraries that compute."""
    found = {"rig": rig.__version__, "python": platform.python_version()}
    return found | {package: version(package) for package in _PACKAGES}


def git_state(folder: Path) -> Mapping[str, Any] | None:
    """Return the commit of a folder's git repository, and whether its files differ from it.

    The keys are `commit` and `dirty`, which is True if a file of the repository has changed or is
    untracked. The result is None if git is missing or takes longer than 5 s, if there is no commit,
    or if the repository does not track the folder, as for an installed package below a checkout.
    """
    commit = _git(folder, "rev-parse", "--verify", "--quiet", "HEAD")
    kept = _git(folder, "ls-files", "--error-unmatch", "__init__.py")
    changes = _git(folder, "status", "--porcelain")
    if commit is None or kept is None or changes is None:
        return None
    return {"commit": commit.strip(), "dirty": bool(changes.strip())}


def _git(folder: Path, *arguments: str) -> str | None:
    # With optional locks, even reading the state would write to the repository.
    command = ["git", "--no-optional-locks", "-C", str(folder), *arguments]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=_GIT_TIMEOUT_S,
            check=True,
        ).stdout
    return None
