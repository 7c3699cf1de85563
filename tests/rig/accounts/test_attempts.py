"""Whoever guesses has to wait; nobody else has."""

import pytest

from rig.accounts import Attempts, TooManyAttemptsError
from rig.accounts.attempts import MOST_SOURCES, OF_A_NAME, OF_A_SOURCE, WITHIN_S


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_one_source_tries_a_name_so_often_a_minute_and_other_sources_and_names_are_free() -> None:
    clock = Clock()
    attempts = Attempts(clock)
    for _ in range(OF_A_NAME):
        attempts.begin("a", "bo")
    clock.now = 20.0
    with pytest.raises(TooManyAttemptsError) as refused:
        attempts.begin("a", "bo")
    assert refused.value.wait_s == 40.0
    attempts.begin("b", "bo")
    attempts.begin("a", "eva")
    clock.now = WITHIN_S
    attempts.begin("a", "bo")


def test_one_source_tries_no_list_of_names() -> None:
    attempts = Attempts(Clock())
    for number in range(OF_A_SOURCE):
        attempts.begin("a", f"name {number}")
    with pytest.raises(TooManyAttemptsError):
        attempts.begin("a", "another")


def test_the_right_password_does_not_count() -> None:
    attempts = Attempts(Clock())
    for _ in range(3 * OF_A_SOURCE):
        attempts.begin("a", "bo")
        attempts.take_back("a", "bo")


def test_guessing_from_everywhere_takes_no_more_memory() -> None:
    attempts = Attempts(Clock())
    for number in range(2 * MOST_SOURCES):
        attempts.begin(str(number), "bo")
    assert len(attempts._times) == MOST_SOURCES
