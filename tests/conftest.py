"""Settings of every test: Hypothesis draws the same examples on every machine of the CI."""

import os
from typing import Final

import pytest
from hypothesis import settings


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the picture of the console in the README be taken by the test that looks at it."""
    parser.addoption("--console-picture", metavar="PNG", help="where the console is photographed")


# A first call may compile for seconds: a deadline per example would measure the compiler.
settings.register_profile("default", deadline=None, max_examples=40)
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


_GAP: Final = (
    "tests/estimator/gap/",
    "tests/rig/cli/test_gap.py",
    "tests/rig/runner/test_gap_closing.py",
    "tests/tools/hidden_effects/test_blind_trials.py",
    "tests/tools/hidden_effects/test_drawn_trials.py",
)
"""What compiles the gap workflow, which takes a minute."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave each file to one worker, and all of the gap workflow: three would compile it thrice."""
    for item in items:
        file = item.nodeid.partition("::")[0]
        group = "gap" if file.startswith(_GAP) else file
        item.add_marker(pytest.mark.xdist_group(group))
