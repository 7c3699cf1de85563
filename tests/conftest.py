"""Settings of every test: Hypothesis draws the same examples on every machine of the CI."""

import os

import pytest
from hypothesis import settings


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the picture of the console in the README be taken by the test that looks at it."""
    parser.addoption("--console-picture", metavar="PNG", help="where the console is photographed")


# A first call may compile for seconds: a deadline per example would measure the compiler.
settings.register_profile("default", deadline=None, max_examples=40)
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")
