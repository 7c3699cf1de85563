"""The table that sets injected faults against found ones, and a campaign's summary in lines."""

from collections.abc import Iterator
from typing import Final

from rich.text import Text

from estimator.leaks import Decision
from faults import to_litres_per_minute
from rig.runner import CampaignOutcome, InjectedFault, Status, TestOutcome
from rig.runner.outcomes import chance, in_passing, reaction
from rig.runner.run_folder import coefficient_unit

from .progress import STYLES

HEADINGS: Final = ("test", "injected", "found", "onset", "latency", "result")


def cells_of(test: TestOutcome) -> tuple[str | Text, ...]:
    """Return the cells of a test's row in the table of verdicts, under `HEADINGS`."""
    decision = test.decision
    passing = [] if decision is None else in_passing(decision, test.found)
    onset_s = None if decision is None else decision.onset_s
    ended = test.status.value.replace("_", " ")
    if test.status == Status.FAILED:
        ended += f", expected {test.expect}"
    done = reaction(test)
    return (
        test.name,
        "\n".join(injected(fault) for fault in test.injected) or "-",
        "\n".join((found(decision), *passing)),
        "" if onset_s is None else f"{onset_s:.2f} s",
        "" if test.latency_s is None else f"{test.latency_s:.1f} s",
        Text(f"{ended}, {done}" if done else ended, STYLES[test.status]),
    )


def injected(fault: InjectedFault) -> str:
    """Return an injected fault in words: kind, size, and when it began, in s.

    The size is the mean flow in L/min; if that is not known, the coefficient.
    """
    size = f"{fault.coefficient:.3g} {coefficient_unit(fault)}"
    if fault.mean_flow_m3_per_s is not None:
        size = f"{to_litres_per_minute(fault.mean_flow_m3_per_s):.3f} L/min"
    return f"{fault.kind} {size} at {fault.at_s:g} s"


def found(decision: Decision | None) -> str:
    """Return a decision in words: verdict, probability, and mean flow with its 95 % interval.

    Return "-" if there is no decision.
    """
    if decision is None:
        return "-"
    parts = (str(decision.verdict), chance(decision), leak(decision))
    return " ".join(part for part in parts if part)


def leak(decision: Decision) -> str:
    """Return a decision's mean leak flow and 95 % interval in L/min; "" if it has no flow."""
    if decision.leak_m3_per_s is None:
        return ""
    flow = f"{to_litres_per_minute(decision.leak_m3_per_s):.3f}"
    interval = decision.interval_m3_per_s
    if interval is None:
        return f"{flow} L/min"
    # The lower end is cut off at zero flow, so the half width is taken from the upper end.
    half = to_litres_per_minute(interval[1] - decision.leak_m3_per_s)
    return f"{flow} ± {half:.3f} L/min"


def summary(outcome: CampaignOutcome, wall_s: float, *, live: bool) -> Iterator[str]:
    """Yield the lines below the table: tests that crashed, numbers by status, rig time and speed.

    The speed is left out for a run at the wall clock (`live`), where it is always the same.
    """
    for test in outcome.tests:
        if test.status == Status.ERROR:
            yield f"{test.name}: {test.message}"
    counts = ", ".join(f"{count} {status.value}" for status, count in outcome.counts.items())
    yield f"{len(outcome.tests)} tests: {counts}".replace("_", " ")
    recorded_s = sum(test.recorded_s for test in outcome.tests)
    took = f"{recorded_s:.0f} s of rig time in {wall_s:.1f} s"
    yield took if live else f"{took}: {recorded_s / wall_s:.0f} rig-seconds per second"
