"""What follows a run of a schedule: the hook command, an argument list that no shell ever sees."""

import subprocess
from collections.abc import Mapping, Sequence
from typing import Final

HOOK_S: Final = 60.0
"""How long a hook may take."""
PLACES: Final = ("schedule", "entry", "campaign", "run", "exit_code", "verdicts", "report", "trend")
"""What may stand in braces in a hook's words."""


def filled(words: Sequence[str], values: Mapping[str, str]) -> list[str]:
    """Return a hook's words with `{name}` replaced, once, by its value; other words stay."""
    return [_filled(word, values) for word in words]


def _filled(word: str, values: Mapping[str, str]) -> str:
    # In one pass: what is put in is never looked at again.
    found, rest = "", word
    while "{" in rest:
        before, _, after = rest.partition("{")
        name, brace, tail = after.partition("}")
        if brace and name in values:
            found, rest = found + before + values[name], tail
        else:
            found, rest = found + before + "{", after
    return found + rest


def run_hook(words: Sequence[str], values: Mapping[str, str], timeout_s: float = HOOK_S) -> str:
    """Run a hook; return what went wrong, empty if nothing did."""
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
