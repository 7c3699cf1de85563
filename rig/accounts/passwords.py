"""Passwords are hashed by Argon2id, at a cost that a guesser must pay for each guess."""

import unicodedata
from typing import Final

from argon2 import PasswordHasher, extract_parameters
from argon2.exceptions import InvalidHashError, VerificationError

MEMORY_KIB: Final = 19_456
"""Memory in KiB that one hash takes: 19 MiB, with `PASSES` passes and one lane.

It is the first of the equally strong settings that OWASP's Password Storage Cheat Sheet (2025)
gives for Argon2id, and the one that disturbs a neighbour's memory least among those of that sheet
with two passes. It takes 25 ms of one processor here. The default of RFC 9106 for small memory
(64 MiB, 3 passes, 4 lanes) takes 0.2 s in four threads, which a loop at 1 kHz on a machine with two
processors should not have beside it.
"""
PASSES: Final = 2
SHORTEST: Final = 15
"""Least number of characters of a password that is the only proof (NIST SP 800-63B-4, 3.1.1.2)."""
LONGEST: Final = 128
"""Most characters of a password; NIST asks that 64 at least are taken."""
LEAST_DIFFERENT: Final = 5
"""Least number of different characters of a password, so that a key held down is none."""
MOST_MEMORY_KIB: Final = 1 << 18
"""Most memory in KiB that a stored hash may ask for: 256 MiB, far above any that is made here."""
MOST_PASSES: Final = 16
MOST_LANES: Final = 4


class Passwords:
    """Hashes passwords and compares them with hashes.

    Args:
        memory_kib: memory in KiB that each new hash takes.
        passes: number of passes over that memory.
    """

    def __init__(self, memory_kib: int = MEMORY_KIB, passes: int = PASSES) -> None:
        self._hasher = PasswordHasher(time_cost=passes, memory_cost=memory_kib, parallelism=1)
        self.decoy = self._hasher.hash("a hash that belongs to nobody")
        """The hash that is compared for a name without an account, so that it takes as long."""

    def hash(self, password: str) -> str:
        """Return a new hash of a password, with its own salt and its costs."""
        return self._hasher.hash(_normal(password))

    def fits(self, hashed: str, password: str) -> bool:
        """Return whether a hash is that of a password; False for a text that is no hash."""
        try:
            return self._hasher.verify(hashed, _normal(password))
        except (VerificationError, InvalidHashError):
            return False


def is_hash(text: str) -> bool:
    """Return whether a text is an Argon2 hash whose comparison costs no more than is allowed."""
    try:
        asked = extract_parameters(text)
    except (InvalidHashError, ValueError):
        return False
    return (
        asked.memory_cost <= MOST_MEMORY_KIB
        and asked.time_cost <= MOST_PASSES
        and asked.parallelism <= MOST_LANES
    )


def checked_password(password: str, name: str) -> str:
    """Return a new password unchanged, if it may be one.

    Args:
        password: the password.
        name: name of the account that it is for.

    Raises:
        ValueError: it is too short, too long, made of too few characters, or holds the name. The
            message says which limit and what to do, and does not repeat the password.
    """
    given = _normal(password)
    if not SHORTEST <= len(given) <= LONGEST:
        raise ValueError(
            f"password: has {len(given)} characters; take {SHORTEST} to {LONGEST}, such as four "
            "words that do not belong together"
        )
    if len(set(given)) < LEAST_DIFFERENT:
        raise ValueError(f"password: take at least {LEAST_DIFFERENT} different characters")
    if _normal(name).casefold() in given.casefold() and len(name) > 2:
        raise ValueError("password: holds the account's name; take one that does not")
    return password


def _normal(password: str) -> str:
    """Return a password as it is hashed, so that two keyboards' ways to write a sign are one.

    NIST SP 800-63B-4 asks for NFKC or NFC. What is no text becomes question marks.
    """
    text = password.encode(errors="replace").decode()
    return unicodedata.normalize("NFKC", text)
