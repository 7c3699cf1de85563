"""What a result came from: software and its versions, git state, model, and the files read."""

import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import rig
from faults import Campaign
from rig.plant import Model

_PACKAGES: Final = ("numpy", "numba", "mcap")
_GIT_TIMEOUT_S: Final = 5.0


def provenance(campaign: Campaign, command: Sequence[str] = ()) -> dict[str, Any]:
    """Return what it takes to run a campaign again, as JSON holds it: versions, git, hashes.

    Args:
        campaign: the campaign.
        command: the command line that runs it, if it was one.
    """
    known = {"command": list(command)} if command else {}
    return known | {
        "versions": versions(),
        "git": git_state(Path(rig.__file__).parent),
        "model_sha256": model_sha256(campaign.model),
        "source_files": dict(campaign.source_files),
    }


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python, and of what the figures depend on."""
    found = {"rig": rig.__version__, "python": platform.python_version()}
    return found | {package: version(package) for package in _PACKAGES}


def model_sha256(model: Model) -> str:
    """Return the SHA-256 (hex) of a model's parameters and effects, whatever its name."""
    content = {"parameters": model.parameters._asdict(), "effects": sorted(model.effects)}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def git_state(folder: Path) -> Mapping[str, Any] | None:
    """Return the commit of the repository that holds a folder, and whether it was changed since.

    None where git is missing, nothing was committed yet, or the repository around the folder does
    not keep it (an installed package below somebody's checkout).
    """
    commit = _git(folder, "rev-parse", "--verify", "--quiet", "HEAD")
    kept = _git(folder, "ls-files", "--error-unmatch", "__init__.py")
    changes = _git(folder, "status", "--porcelain")
    if commit is None or kept is None or changes is None:
        return None
    return {"commit": commit.strip(), "dirty": bool(changes.strip())}


def _git(folder: Path, *arguments: str) -> str | None:
    # Optional locks would let a mere look write to the repository.
    command = ["git", "--no-optional-locks", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=_GIT_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
