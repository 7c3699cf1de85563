"""Runs the hook of a schedule after a run: a command given as an argument list, without a shell."""

import re
import subprocess
from collections.abc import Mapping, Sequence
from typing import Final

HOOK_S: Final = 60.0
"""How long a hook may take, s."""
_PLACE: Final = re.compile(r"\{(\w+)\}")
"""A name in braces, in whose place a value of the run may be put."""


def filled(words: Sequence[str], values: Mapping[str, str]) -> list[str]:
    """Return a hook's arguments with each known `{name}` replaced by its value.

    Values are not searched for names, and unknown names in braces stay as they are.
    """
    return [_PLACE.sub(lambda found: values.get(found[1], found[0]), word) for word in words]


def run_hook(words: Sequence[str], values: Mapping[str, str], timeout_s: float = HOOK_S) -> str:
    """Run a hook, and return a sentence on what went wrong; empty if nothing did.

    Args:
        words: the command and its arguments, with names in braces.
        values: the value of each name.
        timeout_s: the hook is ended after this time, s.
    """
    command = filled(words, values)
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"hook {command[0]}: took more than {timeout_s:g} s, and was ended"
    except (OSError, ValueError) as error:
        return f"hook {command[0]}: {getattr(error, 'strerror', None) or error}"
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [""]
        return f"hook {command[0]}: exit code {done.returncode} {last[0]}".rstrip()
    return ""
