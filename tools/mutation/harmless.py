"""Mutants that no test notices because they change nothing that matters, each with the reason."""

from typing import Final

HARMLESS: Final[dict[str, str]] = {}
"""Reason, by the mutant's name."""
