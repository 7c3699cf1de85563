"""Settings of all tests: order, compiling by several workers, and examples of Hypothesis."""

import gc
import os
from collections.abc import Generator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from rig.compile_cache import use_compile_cache

from . import compiling_sessions
from .compiling_once import (
    PATIENCE_S,
    after_the_first,
    compile_apart,
    compile_once,
    without_looking_for_garbage,
)

HERE = Path(__file__).parent
LONGEST = (
    "estimator/gap/prediction/test_another_plant.py",
    "estimator/leak_lanes/test_lane_detectors.py",
    "estimator/leaks/test_detection.py",
    "rig/console/test_in_chromium.py",
    "rig/supervisor/processes/test_loop_process.py",
    "estimator/leak_lanes/test_growing.py",
    "rig/cli/campaigns/test_run.py",
    "estimator/gap/prediction/test_another_period.py",
    "estimator/gap/verdict/test_keeping.py",
    "rig/runner/experiments/test_gap_closing.py",
    "rig/supervisor/processes/test_publisher.py",
    "rig/console/test_rig_state.py",
    "estimator/gap/servo/test_unfit_recordings.py",
    "chaos/test_kill_and_resume.py",
    "rig/console/test_started.py",
    "rig/console/test_page.py",
    "rig/console/station/test_last_use.py",
    "test_layout.py",
    "rig/runner/experiments/test_tuning.py",
    "rig/runner/experiments/test_friction_experiment.py",
    "estimator/filters/test_registry.py",
    "rig/cli/models/test_sweep.py",
    "rig/runner/campaign/test_compiling.py",
    "rig/cli/campaigns/test_schedule.py",
    "rig/runner/campaign/test_wire_replay.py",
    "estimator/leaks/test_leak_statistic.py",
    "rig/io/test_conformance.py",
    "rig/sweep/test_sweeping.py",
    "rig/loop/wire/test_cycle.py",
    "rig/stream/test_shipped_profiles.py",
    "rig/io/bypass_valves/test_driver.py",
    "test_docs.py",
)
"""Test files that take longest, or that begin to compile what others need.

Workers begin with them, so that no worker still runs one of them when the others have finished. The
first three need no session on a rig, whose code is compiled beside them.
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option by which a test of the console writes the picture for the README."""
    parser.addoption("--console-picture", metavar="PNG", help="where the console is photographed")


def pytest_configure(config: pytest.Config) -> None:
    """Share the compiling of functions that are not in the cache among the workers of a run.

    Tests keep their state, such as counters of rigs, apart from the user's.
    """
    os.environ["XDG_STATE_HOME"] = str(HERE.parent / ".pytest_cache" / "state")
    given = getattr(config, "workerinput", {})
    worker = given.get("workerid", "")
    all_tests = any(HERE.is_relative_to(Path(asked).resolve()) for asked in config.args)
    if not worker:
        if all_tests and config.getoption("numprocesses", None):
            config.add_cleanup(partial(compiling_sessions.end, compiling_sessions.begin()))
        return
    use_compile_cache()
    folder = os.environ.get("NUMBA_CACHE_DIR")
    if not folder:
        return
    compile_once(Path(folder) / "locks")
    number = int(worker.removeprefix("gw"))
    # Meanwhile the last worker makes the bytecode.
    if all_tests and number + 1 < given["workercount"]:
        compile_apart(number)


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect all tests without garbage collection, and keep their objects out of later ones.

    Of the workers one collects first, the last one, as it has nothing to compile before: it makes
    the bytecode that the others then only read.
    """
    folder = os.environ.get("NUMBA_CACHE_DIR")
    with without_looking_for_garbage(), ExitStack() as turn:
        if folder and hasattr(session.config, "workerinput"):
            turn.enter_context(after_the_first(Path(folder) / "locks" / "collecting", PATIENCE_S))
        collected = yield
    gc.freeze()
    return collected


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Move the tests of the files in `LONGEST` to the front, in its order."""
    places = {HERE / file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


# Hypothesis would also draw constants that stand in the sources of all loaded modules: a worker
# would parse 800 files, and an example would depend on what the tests before it have loaded.
vars(providers)["is_local_module_file"] = lambda path: False
# There is no deadline for an example, because a first call may compile for seconds. In the CI,
# examples are the same on every machine.
settings.register_profile("default", deadline=None, max_examples=25)
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")
