"""Draws the panels of leaks and of what the detector made of them, and of the compensation."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import leak_flow
from rig.loop import PROBABILITIES, PROBABLE
from rig.plant import LEAKS, LITRE_PER_MINUTE
from rig.report.accounts import recorded_run
from rig.report.panel import Array, Panel, TestData, Trace, band, limits_of, line, ribbon, steps
from rig.report.wording import label, leaks_found
from rig.runner.campaign import SHUT_S

# For each of LEAKS: its name, the role of its colour, the channels of its true and metered flow.
_CALLED: Final = (
    ("chamber 1", "chamber_1", "true_leak_1_m3_per_s", "flow_1_m3_per_s"),
    ("chamber 2", "chamber_2", "true_leak_2_m3_per_s", "flow_2_m3_per_s"),
    ("internal", "internal", "true_leak_internal_m3_per_s", "flow_internal_m3_per_s"),
)
_LEAST_SPAN: Final = 0.1
"""Least span of an axis of flow in L/min, so that noise does not look like a leak."""
_PERCENT: Final = 100.0
_WORTH_SHOWING: Final = 0.02
"""Probability that a fault must have exceeded at some time to be drawn."""
_ROLES: Final = ("reference", "chamber_1", "chamber_2", "internal", "accent", "bad", "found")
"""Colours of health and of the faults, in the order of `PROBABILITIES`."""


def missing_flow(data: TestData) -> Panel | None:
    """Return the panel of both chambers' missing flow, in L/min.

    It also has the part that is explained by the leaks that the detector found, if it found any.
    The panel is None if the test has no oil accounts.
    """
    accounts = data.accounts
    if accounts is None:
        return None
    missing = accounts.missing / LITRE_PER_MINUTE
    explained = accounts.explained / LITRE_PER_MINUTE
    decision = data.outcome.decision
    start_s, end_s = accounts.start_s, accounts.end_s
    middle_s = 0.5 * (start_s + end_s)
    chambers = [(i, f"chamber {i + 1}", f"chamber_{i + 1}") for i in range(2)]
    traces = [Trace(name, role, "dots", middle_s, missing[:, i]) for i, name, role in chambers]
    if decision is not None and decision.onset_s is not None and explained.any():
        traces += [
            steps(f"{name}, explained by what was found", role, start_s, end_s, explained[:, i])
            for i, name, role in chambers
        ]
    caption = (
        "Oil that came in through the valve and is nowhere to be found, every half second: inflow, "
        "less what moved the piston, less what was compressed, less the model's own errors as "
        "fitted. A sound chamber stays at zero; a leak makes a step."
    )
    limits = limits_of([missing, explained], _LEAST_SPAN)
    return Panel("missing_flow", "Missing oil", caption, "L/min", tuple(traces), limits)


def leak_flows(data: TestData) -> Panel | None:
    """Return the panel of leak flows: as injected or metered, as estimated, and as found.

    A flow meter's reading stands for an injected flow that is not recorded. Estimated are the leak
    states of the filter; found is the mean flow by the detector. The panel has the leaks that were
    injected or found, or all leaks if there are none. It is None if there is nothing to draw.
    """
    recorded: list[Trace] = []
    zeros: list[str] = []
    sources: set[str] = set()
    estimated, shown = [], []
    states = _in_filter_states(data)
    decision = data.outcome.decision
    concerned = {fault.kind for fault in data.outcome.injected} & set(LEAKS)
    concerned |= set() if decision is None else {*leaks_found(decision)}
    for leak, (called, role, truth, meter) in zip(LEAKS, _CALLED, strict=True):
        if concerned and leak not in concerned:
            continue
        was = data.channel(truth)
        source = "injected"
        if was is None:
            was, zero = _metered(data, leak, meter)
            source = "flow meter"
            if zero is not None:
                zeros.append(f"{called} {zero / LITRE_PER_MINUTE:.2f}")
        if was is not None:
            sources.add(source)
            shown.append(was / LITRE_PER_MINUTE)
            style = {"width": 3.4, "opacity": 0.4}
            recorded.append(data.line(f"{called}, {source}", role, shown[-1], **style))
        if leak in states:
            values = states[leak] / LITRE_PER_MINUTE
            shown.append(values[values.size // 10 :])
            estimated.append(data.line(f"{called}, filter's leak state", role, values, width=1.1))
    found = list(_found(data))
    if not recorded and not estimated and not found:
        return None
    caption = "Pale: the leak as it was." if "injected" in sources else ""
    if "flow meter" in sources:
        less = f"less its zero, read before the bypass was opened ({', '.join(zeros)} L/min)"
        caption += f"Pale: what the flow meter read, {less if zeros else 'its zero included'}."
    if estimated:
        caption += " Fine: what the filter's leak state makes of it."
    if found:
        caption += " Dashed: the mean flow found since the onset, with its 95 % interval."
        shown += [trace.values for trace in found]
    traces = (*found[:1], *recorded, *estimated, *found[1:])
    limits = limits_of(shown, _LEAST_SPAN)
    return Panel("leak_flow", "Leak flow", caption.strip(), "L/min", traces, limits)


def evidence(data: TestData) -> Panel | None:
    """Return the panel of the test statistic with its threshold; None without oil accounts."""
    accounts = data.accounts
    if accounts is None:
        return None
    ends = accounts.decided_s
    traces = (
        line("likeliest fault", "ink", ends, accounts.statistic, width=2.2),
        line("threshold", "found", ends, accounts.threshold, width=2.0, dash="dash"),
    )
    caption = (
        "By how many standard errors the likeliest fault stands out. Above the dashed line the "
        "detector calls it; a healthy rig gets there no more often than at the stated rate. What "
        "was confirmed stays on record when the evidence falls again."
    )
    top = float(np.max([accounts.statistic.max(), *accounts.threshold[-1:] * 1.5]))
    return Panel("evidence", "Evidence", caption, "standard errors", traces, (0.0, 1.08 * top))


def _metered(data: TestData, leak: str, meter: str) -> tuple[Array | None, float | None]:
    """Return the readings of a leak's flow meter less its zero offset, and the offset, m^3/s.

    Both are None if the leak was not injected, as the meter then reads only its offset, or if there
    is no meter. If the bypass was not shut for long enough to know the offset, the offset is None
    and the readings are returned unchanged.
    """
    onsets = [fault.at_s for fault in data.outcome.injected if fault.kind == leak]
    flow = data.channel(meter)
    if not onsets or flow is None:
        return None, None
    before = flow[data.recording.time_s < min(onsets)]
    before = before[np.isfinite(before)]
    if min(onsets) < SHUT_S or not before.size:
        return flow, None
    zero = float(before.mean())
    return flow - zero, zero


def _in_filter_states(data: TestData) -> dict[str, Array]:
    """Return each leak's flow by the recorded states of the filter, m^3/s.

    The result is empty if the filter has no leak states, or if they or the parameters are missing.
    """
    run = recorded_run(data.recording, data.filter_name)
    leaks = {f"{leak}_m3_per_s_sqrtPa" for leak in LEAKS}
    if run is None or data.parameters is None or not leaks <= set(run.filter.states):
        return {}
    return leak_flow(run, data.parameters)


def _found(data: TestData) -> Iterator[Trace]:
    """Yield the 95 % band of the found leak flow, if known, then its mean as a line, in L/min.

    Both are drawn as decided over time, or, if that is not recorded, by the final decision from the
    onset on. Nothing is yielded if no flow was found.
    """
    held = list(flow_as_decided(data))
    yield from held
    decision = data.outcome.decision
    if held or decision is None or decision.leak_m3_per_s is None or decision.onset_s is None:
        return
    start, end = decision.onset_s, float(data.recording.time_s[-1])
    if decision.interval_m3_per_s is not None:
        lower, upper = (bound / LITRE_PER_MINUTE for bound in decision.interval_m3_per_s)
        yield band("95 % interval", "found", start, end, lower, upper)
    mean = np.full(2, decision.leak_m3_per_s / LITRE_PER_MINUTE)
    yield line("mean flow found", "found", np.array([start, end]), mean, width=2.2, dash="dash")


def probability(data: TestData) -> Panel | None:
    """Return the panel of the probabilities of health and of each fault, as decided over time.

    A fault whose probability never exceeded 2 % is left out. The panel is None if no probabilities
    are recorded.
    """
    traces = []
    for name, channel, role in zip(PROBABLE, PROBABILITIES, _ROLES, strict=True):
        values = data.channel(channel)
        if values is None or (name != "healthy" and not np.nanmax(values) > _WORTH_SHOWING):
            continue
        traces.append(data.line(label(name), role, values * _PERCENT, width=2.2))
    if not traces:
        return None
    caption = "What the detector held while the test ran, decided anew every half second."
    return Panel("probability", "Probability", caption, "%", tuple(traces), (-4.0, 104.0))


def compensation(data: TestData) -> Panel | None:
    """Return the panel of the valve command, and of its part that compensates for a leak, in V.

    The panel is None if that part is always zero, or if it or the command is not recorded.
    """
    added, sent = data.channel("compensation_V"), data.channel("command_V")
    if added is None or sent is None or not np.nanmax(np.abs(added)) > 0.0:
        return None
    traces = (
        data.line("valve command", "ink", sent, width=1.2),
        data.line("of it for the leak", "accent", added, width=2.2),
    )
    caption = (
        "What the loop sent to the valve, and what it added to the proportional command to make up "
        "for the leak."
    )
    return Panel("compensation", "Command and compensation", caption, "V", traces)


def flow_as_decided(data: TestData) -> Iterator[Trace]:
    """Yield the detector's leak flow as it was decided over time: a band, then a line, in L/min.

    The line is the mean flow since the leak's onset, as each decision gave it, and the band is the
    95 % interval of that mean.
    The band is left out if an end of the interval is not recorded; nothing is yielded if the mean
    is not recorded, or never known.
    """
    names = ("decided_leak_low_m3_per_s", "decided_leak_high_m3_per_s", "decided_leak_m3_per_s")
    channels = [data.channel(name) for name in names]
    low, high, mean = (None if each is None else each / LITRE_PER_MINUTE for each in channels)
    if mean is None:
        return
    # A decision is the same in several rows, of which the first and the last are drawn.
    time_s = data.recording.time_s
    ends = _ends_of_stretches(data.recording["decided_at_s"])
    if low is not None and high is not None:
        yield ribbon("95 % interval", "found", time_s[ends], low[ends], high[ends])
    yield line("mean flow found", "found", time_s[ends], mean[ends], width=2.2, dash="dash")


def _ends_of_stretches(values: Array) -> NDArray[np.int64]:
    """Return the indices of the first and the last value of each run of equal values, sorted.

    NaN counts as equal to NaN.
    """
    known = np.nan_to_num(values, nan=-1.0)
    starts = np.flatnonzero(np.diff(known, prepend=np.inf))
    return np.union1d(starts, np.append(starts[1:] - 1, values.size - 1))
