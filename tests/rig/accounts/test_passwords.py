"""A password is known by its hash alone, which costs a guesser time and memory."""

import pytest
from argon2 import Type, extract_parameters

from rig.accounts import Passwords, checked_password
from rig.accounts.passwords import LONGEST, MEMORY_KIB, PASSES, SHORTEST, is_hash

CHEAP = Passwords(memory_kib=8, passes=1)
GOOD = "four words that differ"


def test_only_the_password_fits_its_hash_and_each_hash_has_its_own_salt() -> None:
    hashed = CHEAP.hash(GOOD)
    assert CHEAP.fits(hashed, GOOD)
    assert not CHEAP.fits(hashed, GOOD + " ")
    assert not CHEAP.fits(CHEAP.decoy, GOOD)
    assert hashed != CHEAP.hash(GOOD)
    assert GOOD not in hashed


def test_a_password_is_hashed_at_the_stated_cost_by_argon2id() -> None:
    asked = extract_parameters(Passwords().decoy)
    assert (asked.type, asked.memory_cost, asked.time_cost, asked.parallelism) == (
        Type.ID, MEMORY_KIB, PASSES, 1,
    )  # fmt: skip


def test_two_keyboards_ways_to_write_a_sign_are_one() -> None:
    assert CHEAP.fits(CHEAP.hash("Zoe\u0308 sees the rig"), "Zo\u00eb sees the rig")


@pytest.mark.parametrize("hostile", ["\ud800" * 20, "\x00" * 20, "", "x" * 5000])
def test_any_text_is_compared_and_fits_nothing(hostile: str) -> None:
    assert not CHEAP.fits(CHEAP.decoy, hostile)


@pytest.mark.parametrize(
    ("password", "why"),
    [
        ("x" * (SHORTEST - 1), "has 14 characters; take 15 to 128"),
        ("abcde" * LONGEST, "take 15 to 128"),
        ("abab" * 5, "at least 5 different"),
        ("my name is BO MEIER", "holds the account's name"),
    ],
)
def test_a_password_that_is_guessed_too_easily_is_refused_and_not_repeated(
    password: str, why: str
) -> None:
    with pytest.raises(ValueError, match=why) as refused:
        checked_password(password, "Bo Meier")
    assert password not in str(refused.value)
    assert checked_password(GOOD, "Bo Meier") == GOOD


@pytest.mark.parametrize(
    "text", ["", "secret", "$argon2id$v=19$m=4000000,t=2,p=1$c2FsdHNhbHQ$aGFzaGhhc2g"]
)
def test_what_is_no_hash_or_costs_too_much_to_compare_is_none(text: str) -> None:
    assert not is_hash(text)
    assert is_hash(CHEAP.decoy)
