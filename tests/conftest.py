"""Settings of every test: Hypothesis draws the same examples on every machine of the CI."""

import gc
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from rig.compile_cache import use_compile_cache

from .compiling_once import compile_apart, compile_once, without_looking_for_garbage

HERE = Path(__file__).parent
LONGEST = (
    "console/test_in_chromium.py",
    "estimator/gap/prediction/test_another_plant.py",
    "rig/supervisor/processes/test_publisher.py",
    "console/test_started.py",
    "chaos/test_ways_to_end.py",
    "rig/runner/campaign/test_compiling.py",
    "chaos/test_kill_and_resume.py",
    "rig/cli/models/test_sweep.py",
    "rig/supervisor/processes/test_loop_process.py",
    "tools/hidden_effects/test_blind_trials.py",
    "rig/runner/campaign/test_wire_replay.py",
    "rig/cli/campaigns/test_run.py",
    "console/test_rig_state.py",
    "console/test_page.py",
    "rig/runner/experiments/test_gap_closing.py",
    "estimator/gap/verdict/test_keeping.py",
    "estimator/leaks/test_detection.py",
    "estimator/leaks/test_leak_statistic.py",
    "estimator/leaks/test_leak_sizes.py",
)
"""Files that take ten seconds and more, with whose tests the workers begin: none of them is then
left with one when the others have done."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the picture of the console in the README be taken by the test that looks at it."""
    parser.addoption("--console-picture", metavar="PNG", help="where the console is photographed")


def pytest_configure(config: pytest.Config) -> None:
    """Let the workers of a run compile together what none of them finds in the cache."""
    worker = getattr(config, "workerinput", {}).get("workerid", "")
    if not worker:
        return
    use_compile_cache()
    folder = os.environ.get("NUMBA_CACHE_DIR")
    if not folder:
        return
    compile_once(Path(folder) / "locks")
    if any(HERE.is_relative_to(Path(asked).resolve()) for asked in config.args):
        compile_apart(int(worker.removeprefix("gw")))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Import all tests without looking for garbage, and never look at what that has made."""
    with without_looking_for_garbage():
        collected = yield
    gc.freeze()
    return collected


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of the files that take longest first."""
    places = {HERE / file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


# A first call may compile for seconds: a deadline per example would measure the compiler.
settings.register_profile("default", deadline=None, max_examples=40)
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")
