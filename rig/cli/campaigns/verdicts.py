"""The table that sets injected faults against found ones, and a campaign's summary in lines."""

from collections.abc import Iterator

from rich.table import Table
from rich.text import Text

from estimator.leaks import Decision
from faults import to_litres_per_minute
from rig.cli.screen import table_of
from rig.runner import CampaignOutcome, InjectedFault, Status, TestOutcome
from rig.runner.outcomes import chance, in_passing, reaction
from rig.runner.run_folder import coefficient_unit

from .progress import STYLES


def verdict_table(outcome: CampaignOutcome, *, plain: bool) -> Table:
    """Return a table with a row for each test of a campaign; `plain` draws it with ASCII."""
    headings = ("test", "injected", "found", "onset", "latency", "result")
    table = table_of(headings, plain=plain, right=("onset", "latency"))
    for test in outcome.tests:
        table.add_row(
            Text(test.name),
            Text("\n".join(injected(fault) for fault in test.injected) or "-"),
            Text("\n".join((found(test.decision), *_passing(test)))),
            Text(_onset(test)),
            Text("" if test.latency_s is None else f"{test.latency_s:.1f} s"),
            Text(_result(test), STYLES[test.status]),
        )
    return table


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


def _passing(test: TestOutcome) -> list[str]:
    return [] if test.decision is None else in_passing(test.decision, test.found)


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


def _onset(test: TestOutcome) -> str:
    if test.decision is None or test.decision.onset_s is None:
        return ""
    return f"{test.decision.onset_s:.2f} s"


def _result(test: TestOutcome) -> str:
    ended = test.status.value.replace("_", " ")
    if test.status == Status.FAILED:
        ended += f", expected {test.expect}"
    done = reaction(test)
    return f"{ended}, {done}" if done else ended
