"""This module keeps between processes how many SI units the usual units are.

A process that reads a file with usual units only need not import pint then, which takes a quarter
of a second.
"""

import json
import os
from collections.abc import Callable, Sequence
from decimal import Decimal
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from tempfile import mkstemp

from rig.compile_cache import cache_home

Pair = tuple[str, str]
"""A unit, and the SI unit in which it is wanted."""


def kept_factors(
    pairs: Sequence[Pair], definitions: Sequence[str], factor: Callable[[str, str], Decimal | None]
) -> dict[Pair, Decimal | None]:
    """Return how many SI units the unit of each pair is, from a file in the user's cache directory.

    It is None for a pair of which the unit measures something else than the SI unit.

    If the file is missing or damaged, the factors are worked out and the file is written anew. The
    result is empty if that cannot be written: working out all factors takes each process longer
    than working out those that it needs.

    Args:
        pairs: the usual units, each with its SI unit.
        definitions: what the factors depend on besides pint's own definitions.
        factor: works out the factor of a pair, or None.
    """
    key = repr((version("pint"), definitions, pairs))
    path = cache_home() / f"hydraulic-rig-units/factors-{sha256(key.encode()).hexdigest()[:16]}"
    kept = _read(path)
    if len(kept) != len(pairs):
        kept = _written(path, lambda: [_text(factor(*pair)) for pair in pairs])
    texts = zip(pairs, kept, strict=False)
    return {pair: None if text is None else Decimal(text) for pair, text in texts}


def _text(factor: Decimal | None) -> str | None:
    return None if factor is None else str(factor)


def _read(path: Path) -> list[str | None]:
    """Return the numbers that a file keeps; none if it is missing or its digest is not theirs."""
    try:
        digest, _, text = path.read_text("ascii").partition("\n")
    except (OSError, ValueError):
        return []
    return json.loads(text) if digest == _digest(text) else []


def _written(path: Path, numbers: Callable[[], list[str | None]]) -> list[str | None]:
    """Return the numbers after they were written to the file; none if it cannot be written."""
    new = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, new = mkstemp(dir=path.parent)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            worked_out = numbers()
            text = json.dumps(worked_out)
            file.write(f"{_digest(text)}\n{text}")
        os.replace(new, path)
    except OSError:
        if new:
            Path(new).unlink(missing_ok=True)
        return []
    return worked_out


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()
