"""The key `leak_test` of a test, which locks the cylinder by its blocking valves, and its plan."""

from collections.abc import Iterator
from math import inf, isfinite
from typing import Annotated, Final

from control import Constant
from estimator.leak_test import INTERVAL, SMALLEST, BlockingLeak, foreseen_limits, levels_of
from faults import CampaignTest, LeakTestStep, Verdict
from rig.configuration.reading import Located, Physical, Schema, read_mapping, show
from rig.configuration.rigs import Rig
from rig.plant import LEAKS, LITRE_PER_MINUTE, Model

LEAK_TEST_S: Final = 35.0
"""How long a leak test takes, s: three soaks of 7 s, and valves and pressures before each."""
KEYS: Final = ("name", "leak_test", "expect", "settle", "wait_for", "repeats", "seed", "matrix")
"""Keys of a test that locks the cylinder; all others are about a motion."""
LEAK_TEST_HZ: Final = 50.0
"""Samples a second on hardware, as in manual mode. What is foreseen hardly depends on it."""

_FLOW: Final = Physical("m^3/s", 0.0001 * LITRE_PER_MINUTE, LITRE_PER_MINUTE)
"""A tenth of the least leak that such a test finds, to more than it can judge, which is the leak
that takes a chamber below 1 MPa within 1.5 s."""
_VERDICTS: Final = (Verdict.HEALTHY, *map(Verdict, LEAKS), Verdict.MULTIPLE)


class LeakTestFile(Schema):
    """Keys of `leak_test`: what a test asks that locks the cylinder and measures its leaks."""

    at_most: Annotated[float | None, _FLOW] = None
    could_see: Annotated[float | None, _FLOW] = None


def read_leak_test(test: Located, rig: Rig | None) -> LeakTestStep | None:
    """Return what a test asks of the leak test that it is; record what does not go with one.

    Args:
        test: the test, with its defaults, which has the key `leak_test`.
        rig: its rig, which needs blocking valves; None if it is unusable.
    """
    item = test.get("leak_test")
    file = read_mapping(LeakTestFile, item)
    for key, _ in test.items():
        if key not in KEYS and test.get(key) is not None:
            limit = "does not go with leak_test, in which the locked ram does not move"
            remedy = f"leave it out, or give it to a test of its own; its keys: {', '.join(KEYS)}"
            test.refuse(limit, remedy, key=key)
    expect = test.get("expect")
    if expect is not None and expect.value in list(Verdict) and expect.value not in _VERDICTS:
        remedy = f"expect one of {', '.join(_VERDICTS)}"
        expect.refuse("is nothing that a leak test finds", remedy)
    if item is not None and rig is not None and rig.blocking_valves is None:
        item.refuse(
            f"needs blocking valves, and the rig {rig.name} has none (`blocking_valves`)",
            "fit them and describe them in the rig file as config/rigs/locked.yaml does, or use a "
            "test with a motion, which finds larger leaks (docs/leak_test.md)",
            value="",
        )
    if file is None:
        return None
    return LeakTestStep(
        at_most_m3_per_s=inf if file.at_most is None else file.at_most,
        could_see_m3_per_s=inf if file.could_see is None else file.could_see,
        judges_verdict=file.at_most is None or expect is not None,
    )


def place_of(rig: Rig) -> Constant:
    """Return where the ram stands in a leak test: midway between its limits, m."""
    return Constant(0.5 * (rig.limits.position_min_m + rig.limits.position_max_m))


def foreseen_leaks(rig: Rig, assumed: Model) -> tuple[float, ...]:
    """Return the smallest leaks in m^3/s that 95 of 100 tests of a rig will find.

    They are in the order of `rig.plant.LEAKS`, for a ram at mid stroke.

    Args:
        rig: a rig with blocking valves.
        assumed: what is assumed of it.
    """
    valves, par = rig.blocking_valves, assumed.parameters
    if valves is None:
        raise ValueError(f"{rig.name} has no blocking valves")
    blocking, middle = BlockingLeak(valves.leak, valves.leak_pressure), place_of(rig).value
    return foreseen_limits(levels_of(par), par, rig.sensors, blocking, middle, LEAK_TEST_HZ)


def planned_lines(test: CampaignTest, rig: Rig, assumed: Model) -> Iterator[str]:
    """Yield what a test that locks the cylinder does, and what it will see."""
    step, valves, levels = test.leak_test, rig.blocking_valves, levels_of(assumed.parameters)
    if step is None or valves is None:
        return
    yield (
        f"  leak test at {show(place_of(rig).value, 'm')}: chambers locked at "
        f"{show(levels.pressure, 'Pa')}, {show(levels.low, 'Pa')} and {show(levels.pressure, 'Pa')}"
    )
    yield f"  blocking valves leak at most {show(valves.leak, 'm^3/s')} by their data sheet"
    limits = (show(size, "m^3/s") for size in foreseen_leaks(rig, assumed))
    yield f"  could see {', '.join(map(' '.join, zip(LEAKS, limits, strict=True)))}"
    if step.judges_verdict:
        yield f"  expect {test.expect}"
    if isfinite(step.at_most_m3_per_s):
        yield (
            f"  pass by each leak's 95 % interval at most {show(step.at_most_m3_per_s, 'm^3/s')}"
        )
    if isfinite(step.could_see_m3_per_s):
        asked = show(step.could_see_m3_per_s, "m^3/s")
        yield f"  pass by having been able to see {asked} in each place"


def step_warnings(test: CampaignTest, rig: Rig, assumed: Model, judged_by: str) -> Iterator[str]:
    """Yield warnings of a leak test that cannot pass, or is not run where the file has it.

    Args:
        test: the test.
        rig: its rig, with blocking valves.
        assumed: what is assumed of it.
        judged_by: name of the filter that judges the other tests.
    """
    step = test.leak_test
    if step is None:
        return
    size, name = max(zip(foreseen_leaks(rig, assumed), LEAKS, strict=True))
    # In the mean the interval of a tight cylinder ends half its width above 0.
    for key, asked, reached in (
        ("could_see", step.could_see_m3_per_s, size),
        ("at_most", step.at_most_m3_per_s, INTERVAL / SMALLEST * size),
    ):
        if asked < reached:
            yield (
                f"{key} {show(asked, 'm^3/s')} is less than what is to be expected of a tight "
                f"cylinder, {show(reached, 'm^3/s')} for {name}, so that the test is likely to "
                "fail; ask for no less, or fit tighter blocking valves"
            )
    if judged_by.startswith("thesis"):
        yield (
            f"judged by {judged_by} the healthy tests are run first, so that the leak test may "
            "come later than the file has it"
        )
