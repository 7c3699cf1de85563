"""The words and the page of `rig leak-test`."""

from collections.abc import Iterator

from rig.plant import LITRE_PER_MINUTE
from rig.report.templating import rendered
from rig.runner.leak_test import PLACES, LeakTest, leak_test_lines

HEADINGS = ("place", "verdict", "L/min", "95 % interval", "could have seen", "limited by")
"""Headings of the table that `leak_rows` fills."""


def leak_rows(test: LeakTest) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a row for each place, flows in L/min."""
    for each in test.found.findings:
        flow, low, high, smallest = (
            value / LITRE_PER_MINUTE for value in (each.flow, each.lower, each.upper, each.smallest)
        )
        yield (
            PLACES[each.name],
            "leak" if each.is_leak else "healthy",
            f"{flow:.5f}",
            f"{low:.5f} to {high:.5f}",
            f"{smallest:.5f}",
            each.limited_by,
        )


def leak_sentences(test: LeakTest) -> tuple[str, ...]:
    """Return in sentences at which pressures the flows are stated, and how sure a verdict is."""
    levels = test.found.levels
    *_, valves = leak_test_lines(test)
    foreseen = ", ".join(f"{value / LITRE_PER_MINUTE:.5f}" for value in test.foreseen)
    return (
        f"Flows out of a chamber are stated at {1e-6 * levels.pressure:.1f} MPa, that across the "
        f"piston at a difference of {1e-6 * levels.difference:.1f} MPa.",
        "One in a hundred tests of a tight cylinder accuses it in any place. What the test could "
        "have seen is the leak that 95 of 100 such tests name; computed before it: "
        f"{foreseen} L/min.",
        f"Found of the {valves}.",
        f"It took {test.duration_s:.0f} s. What is left unexplained is {test.found.misfit:.1f} "
        "times what the sensors' noise is expected to leave.",
    )


def leak_test_page(test: LeakTest, started: str) -> str:
    """Return the HTML page of a leak test, which began at `started`, UTC, as text."""
    soaks = soak_rows(test)
    return rendered(
        "leak_test.html.j2",
        rig=test.rig,
        started=started,
        headings=HEADINGS,
        rows=list(leak_rows(test)),
        sentences=leak_sentences(test),
        soaks=soaks,
    )


def soak_rows(test: LeakTest) -> list[tuple[str, ...]]:
    """Return the cells of a row for each soak: pressures at first and last, MPa, and way, um."""
    return [
        (
            f"{number}",
            *(f"{1e-6 * value:.2f}" for value in (*soak.pressure_1, *soak.pressure_2)),
            f"{1e6 * soak.way:.0f}",
        )
        for number, soak in enumerate(test.ends, start=1)
    ]
