"""Settings of all tests: order, compiling by several workers, and examples of Hypothesis."""

import gc
import os
from collections.abc import Generator
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

import pytest
from hypothesis import settings

from rig.compile_cache import use_compile_cache

from . import compiling_sessions
from .compiling_once import (
    PATIENCE_S,
    compile_apart,
    compile_once,
    only_one,
    without_looking_for_garbage,
)

HERE = Path(__file__).parent
COLLECTING = pytest.StashKey[Path]()
"""Where the file is whose lock a worker holds while it collects the tests."""
LONGEST = (
    "estimator/leak_lanes/test_lane_detectors.py",
    "estimator/leaks/test_growth.py",
    "estimator/leaks/test_detection.py",
    "rig/console/test_in_chromium.py",
    "rig/supervisor/processes/test_publisher.py",
    "rig/supervisor/processes/test_loop_process.py",
    "rig/cli/models/test_sweep.py",
    "estimator/leak_lanes/test_growing.py",
    "rig/cli/campaigns/test_run.py",
    "estimator/gap/servo/test_unfit_recordings.py",
    "rig/console/test_started.py",
    "test_docs.py",
    "rig/runner/experiments/test_gap_closing.py",
    "rig/runner/campaign/test_wire_replay.py",
    "chaos/test_kill_and_resume.py",
    "test_layout.py",
    "estimator/filters/test_registry.py",
    "estimator/leaks/test_leak_statistic.py",
    "estimator/leaks/test_growing.py",
    "rig/runner/experiments/test_tuning.py",
    "rig/supervisor/test_another_master.py",
    "rig/runner/run_folder/test_resuming.py",
    "rig/runner/experiments/test_friction_experiment.py",
    "rig/loop/interlocks/test_plausibility.py",
    "rig/configuration/reading/test_config_errors.py",
    "rig/report/test_accounts.py",
    "rig/io/test_conformance.py",
    "rig/loop/wire/test_cycle.py",
    "rig/cli/live/test_monitor.py",
    "rig/runner/campaign/test_compiling.py",
    "rig/console/test_rig_state.py",
    "rig/console/test_page.py",
    "rig/stream/test_shipped_profiles.py",
    "rig/io/bypass_valves/test_driver.py",
)
"""Test files that take five seconds or more.

Workers begin with them, so that no worker still runs one of them when the others have finished.
The first three need nothing of what sessions with rigs run. While they run, that is compiled
(`compiling_sessions.py`); a rig that is started earlier costs processor time while it waits.
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option by which a test of the console writes the picture for the README."""
    parser.addoption("--console-picture", metavar="PNG", help="where the console is photographed")


def pytest_configure(config: pytest.Config) -> None:
    """Share the compiling of functions that are not in the cache among the workers of a run.

    Tests keep their state, such as counters of rigs, apart from the user's.
    """
    os.environ["XDG_STATE_HOME"] = str(HERE.parent / ".pytest_cache" / "state")
    worker = getattr(config, "workerinput", {}).get("workerid", "")
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
    if all_tests:
        compile_apart(int(worker.removeprefix("gw")))
        config.stash[COLLECTING] = Path(folder) / "locks" / "collecting"


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect all tests without garbage collection, and keep their objects out of later ones.

    Workers collect one after the other: the first writes the bytecode of all tests, and the others
    read it. In a fresh checkout, each would otherwise compile all test files to bytecode.
    """
    lock = session.config.stash.get(COLLECTING, None)
    alone: AbstractContextManager[None] = (
        nullcontext() if lock is None else only_one(lock, PATIENCE_S)
    )
    with alone, without_looking_for_garbage():
        collected = yield
    gc.freeze()
    return collected


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Move the tests of the files in `LONGEST` to the front, in its order."""
    places = {HERE / file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


# There is no deadline for an example, because a first call may compile for seconds. In the CI,
# examples are the same on every machine.
settings.register_profile("default", deadline=None, max_examples=25)
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")
