"""Every reader of files and protocols answers a fixed set of inputs as it should.

The inputs are valid ones, those that were once found by `make fuzz`, and some that are made of
these by a seed.
"""

import random
from collections.abc import Iterator
from typing import Final

import pytest

from tools.fuzz.guides import GUIDES
from tools.fuzz.mutations import mutated
from tools.fuzz.target import tried
from tools.fuzz.targets import CORPUS, TARGETS, corpus_of

SEED: Final = 20
SLOW: Final = ("campaign", "schedule", "sweep", "rig", "map")
"""Targets that take over 20 ms for an input."""


def inputs(name: str) -> Iterator[bytes]:
    """Yield the corpus of a target, the smallest only of a slow one, and inputs made of it."""
    corpus = corpus_of(TARGETS[name])
    draws = random.Random(SEED)
    if name in SLOW:
        corpus = sorted(corpus, key=len)[:1]
    yield from corpus
    for _ in range(2 if name in SLOW else 10):
        yield mutated(draws.choice(corpus), draws)


@pytest.mark.parametrize("name", TARGETS)
def test_a_reader_takes_its_corpus_or_refuses_it_in_words(name: str) -> None:
    for data in inputs(name):
        assert tried(TARGETS[name], data) is None


def test_every_target_has_a_guide_and_every_folder_of_the_corpus_a_target() -> None:
    assert GUIDES.keys() == TARGETS.keys()
    assert {folder.name for folder in CORPUS.iterdir()} <= TARGETS.keys()
