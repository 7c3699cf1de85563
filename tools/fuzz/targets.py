"""All targets, and what is kept for them in the corpus."""

from pathlib import Path
from typing import Final

from .files import FILES
from .protocols import PROTOCOLS
from .target import Target

CORPUS: Final = Path(__file__).parent / "corpus"
"""A folder for each target, with inputs that once were finds, or that lead far into its reader."""
TARGETS: Final[dict[str, Target]] = {target.name: target for target in (*FILES, *PROTOCOLS)}


def corpus_of(target: Target) -> list[bytes]:
    """Return the inputs that a target begins with: its seeds, and what the corpus keeps for it."""
    kept = sorted((CORPUS / target.name).glob("*"))
    return [*target.seeds(), *(path.read_bytes() for path in kept)]
