"""Plays one scenario of the chaos suite from beginning to end."""

from pathlib import Path

from .judge import Outcome, judge
from .scenario import Scenario
from .stage import NotBegunError, Stage

_STAGES = 3
"""How often a scenario is set up: on a machine that stalls, the rig may trip before its test."""


def play(scenario: Scenario, folder: Path) -> Outcome:
    """Play a scenario in an empty folder and return its outcome.

    If the run ends before its test, the scenario is set up again, up to `_STAGES` times in all.

    Raises:
        StageError: the emulator did not start, refused a fault or ended, the test never began, the
            rig did not become safe, or the run did not end or left processes behind.
    """
    for number in range(1, _STAGES):
        place = folder / str(number)
        place.mkdir()
        try:
            return _played(scenario, place)
        except NotBegunError:
            continue
    place = folder / str(_STAGES)
    place.mkdir()
    return _played(scenario, place)


def _played(scenario: Scenario, folder: Path) -> Outcome:
    with Stage(folder, scenario.prefix) as stage:
        stage.begin()
        for step in scenario.steps:
            step(stage)
        injected_ns = stage.injected_ns
        if scenario.then:
            stage.wait(stage.is_safe, "the safe state")
            for step in scenario.then:
                step(stage)
            stage.injected_ns = injected_ns
        stage.wait(lambda: stage.run.poll() is not None, "`rig run` to end")
        if not scenario.unsafe:
            stage.wait(stage.is_safe, "the safe state")
        stage.wait(lambda: not stage.living(), "its processes to end")
    return judge(stage)
