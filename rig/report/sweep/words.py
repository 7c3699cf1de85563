"""Puts the results of a sweep into words, for the terminal and for its page."""

from collections.abc import Iterator

from rig.plant import LITRE_PER_MINUTE
from rig.sweep import LEAST_CASES, PowerCurve, Share, Study, Timing


def in_flow(flow: float | None, digits: int = 2) -> str:
    """Return a flow in m^3/s as text in L/min; "none" if it is None."""
    return "none" if flow is None else f"{flow / LITRE_PER_MINUTE:.{digits}g} L/min"


def of_share(share: Share) -> str:
    """Return a share as text: its count, of how many cases, and its 95 % interval in percent."""
    if not share.of:
        return "none of 0"
    low, high = (100.0 * end for end in share.interval)
    return f"{share.count} of {share.of} ({low:.1f} to {high:.1f} %)"


def limit_in_words(curve: PowerCurve) -> str:
    """Return as text the flow from which on the wanted share of leaks is named, with its interval.

    If no such flow was estimated, the text says what is known instead.
    """
    # Adaptive sweeps come to intervals that two digits would not tell.
    digits = 3 if curve.steps else 2
    if curve.limit_m3_per_s is not None and curve.interval_m3_per_s is not None:
        low, high = (in_flow(end, digits) for end in curve.interval_m3_per_s)
        return f"{in_flow(curve.limit_m3_per_s, digits)} ({low} to {high})"
    if curve.at_most_m3_per_s is not None:
        return f"not known: {in_flow(curve.at_most_m3_per_s, 3)} or less"
    if curve.at_least_m3_per_s is not None:
        return f"not known: {in_flow(curve.at_least_m3_per_s, 3)} or more"
    missed, named = curve.missed_m3_per_s, curve.named_m3_per_s
    if missed is None and named is None:
        return "no leak with a flow"
    if missed is None:
        return f"not known: all {curve.cases} were named, down to {in_flow(named)}"
    if named is None:
        return f"not known: none of {curve.cases} was named, up to {in_flow(missed)}"
    if curve.separates:
        whole = f"none up to {in_flow(missed, 3)}, all from {in_flow(named, 3)} on"
        return f"{whole}: {curve.cases} cases draw no curve between"
    if curve.cases < LEAST_CASES:
        return f"not known: {curve.cases} cases are too few"
    return "not known: beyond the flows that were drawn"


def times_in_100(share: float) -> str:
    """Return a share as text: "95 times in 100"."""
    return f"{100.0 * share:.3g} times in 100"


def _rate(rate: float | None) -> str:
    """Return a rate as text; one below 10, as while code is compiled, has two digits."""
    if rate is None:
        return "an unknown number"
    return f"{rate:.0f}" if rate >= 10.0 else f"{rate:.2g}"


def place_in_words(place: str) -> str:
    """Return the name of a fault, or of all leaks together, in words."""
    return "all leaks" if place == "all" else place.replace("_", " ")


def lines_of(filter_name: str, study: Study, timing: Timing) -> Iterator[str]:
    """Yield the results of a sweep as lines for the terminal.

    Args:
        filter_name: the filter that judged the cases.
        study: the statistics of all cases.
        timing: how long the cases took.
    """
    if study.lost.count:
        lost = f"  the filter lost its rig in {of_share(study.lost)} cases"
        yield f"{lost}: verdicts by such a filter mean little"
    for name, share in study.right.items():
        yield f"  {place_in_words(name)}: {of_share(share)} named right"
    if study.false_alarms.of:
        yield f"  healthy cases accused at some time: {of_share(study.false_alarms)}"
    for place, curve in study.power.items():
        wanted, of = times_in_100(curve.share), place_in_words(place)
        line = f"  named {wanted}, of {of}, from: {limit_in_words(curve)}"
        yield f"{line}, by {curve.cases} cases" if curve.steps else line
    if study.latency_s is not None:
        yield f"  latency: median {study.latency_s[0]:.1f} s, 95 % {study.latency_s[1]:.1f} s"
    rates = timing.plain()["rig_seconds_per_second"]
    if timing.cases and rates["of_process_after_start"]:
        yield (
            f"  {timing.cases} cases by {filter_name} on {len(timing.ready_s)} processes: "
            f"{_rate(rates['of_process_after_start'])} rig-seconds per second and process, "
            f"{_rate(rates['of_processor'])} per processor second, after "
            f"{timing.start_s:.1f} s of start-up"
        )
