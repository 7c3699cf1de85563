"""A sweep's findings in words: lines for the terminal, and for its page."""

from collections.abc import Iterator

from rig.plant.parameters import LITRE_PER_MINUTE
from rig.sweep.running import Timing
from rig.sweep.study import PowerCurve, Share, Study


def in_flow(flow: float) -> str:
    """Return a flow in m^3/s as text in L/min."""
    return f"{flow / LITRE_PER_MINUTE:.2g} L/min"


def of_share(share: Share) -> str:
    """Return a part of some cases with its 95 % interval."""
    if not share.of:
        return "none of 0"
    low, high = (100.0 * end for end in share.interval)
    return f"{share.count} of {share.of} ({low:.1f} to {high:.1f} %)"


def limit_in_words(curve: PowerCurve) -> str:
    """Return the smallest leak that is found, as text."""
    if curve.limit_m3_per_s is None or curve.interval_m3_per_s is None:
        return "not bracketed by these cases"
    low, high = (in_flow(end) for end in curve.interval_m3_per_s)
    return f"{in_flow(curve.limit_m3_per_s)} ({low} to {high})"


def place_in_words(place: str) -> str:
    """Return the name of a fault as a reader's."""
    return "all leaks" if place == "all" else place.replace("_", " ")


def lines_of(filter_name: str, study: Study, timing: Timing) -> Iterator[str]:
    """Yield what came of a sweep, a line each."""
    for name, share in study.right.items():
        yield f"  {place_in_words(name)}: {of_share(share)} named right"
    if study.false_alarms.of:
        yield f"  healthy cases accused at some time: {of_share(study.false_alarms)}"
    for place, curve in study.power.items():
        yield f"  95 in 100 of {place_in_words(place)} are named from {limit_in_words(curve)}"
    if study.latency_s is not None:
        yield f"  latency: median {study.latency_s[0]:.1f} s, 95 % {study.latency_s[1]:.1f} s"
    if study.lost.count:
        yield f"  the filter lost its rig in {of_share(study.lost)}"
    rates = timing.told()["rig_seconds_per_second"]
    if timing.cases and rates["of_process_after_start"]:
        yield (
            f"  {timing.cases} cases by {filter_name} on {len(timing.workers)} processes: "
            f"{rates['of_process_after_start']:.0f} rig-seconds per second and process, "
            f"{rates['of_processor'] or 0.0:.0f} per processor second, after "
            f"{timing.start_s:.1f} s of start-up"
        )
