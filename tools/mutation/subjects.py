"""The modules that are mutated, each with the tests that are to notice."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
_INTERLOCKS: Final = "tests/rig/loop/interlocks"


@dataclass(frozen=True)
class Subject:
    """A module and its tests, which must pass with the JIT off, and take seconds then.

    Attributes:
        name: what docs/safety.md calls it.
        module: name of the module.
        tests: files of tests, those first that notice most.
    """

    name: str
    module: str
    tests: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The module's file."""
        return ROOT.joinpath(*self.module.split(".")).with_suffix(".py")


SUBJECTS: Final = (
    Subject(
        "interlock",
        "rig.loop.interlocks.judging",
        (
            f"{_INTERLOCKS}/test_judging.py",
            f"{_INTERLOCKS}/test_judging_bounds.py",
            f"{_INTERLOCKS}/test_passings.py",
        ),
    ),
    Subject(
        "plausibility",
        "rig.loop.interlocks.plausibility",
        (f"{_INTERLOCKS}/test_plausibility_bounds.py", f"{_INTERLOCKS}/test_judging.py"),
    ),
    Subject("states", "rig.supervisor.states", ("tests/rig/supervisor/test_states.py",)),
    Subject(
        "ladder",
        "rig.loop.interlocks.ladder",
        (f"{_INTERLOCKS}/test_ladder.py", f"{_INTERLOCKS}/test_judging.py"),
    ),
)
