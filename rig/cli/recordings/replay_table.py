"""The table of `rig replay`: what was found, and what would help where nothing could be."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from rich import box
from rich.table import Table
from rich.text import Text

from estimator.leaks import Decision, Found
from faults import Verdict, to_litres_per_minute
from rig.cli.campaigns import leak
from rig.plant import LEAKS
from rig.runner.outcomes import chance, in_passing, percent

_COLUMNS: Final = ("recording", "verdict", "onset", "detected", "leak flow", "statistic/threshold")


@dataclass(frozen=True)
class Replayed:
    """What filter and detector made of one recording; `recording` is the argument as given."""

    recording: str
    filter: str
    decision: Decision
    detected_at_s: float | None
    filter_resets_s: tuple[float, ...] = ()
    """When the filter was lost and started anew."""
    found: tuple[Found, ...] = ()
    """All faults that were named, those that went again among them."""


def replay_table(replayed: Iterable[Replayed], *, plain: bool) -> Table:
    """Return a table of recordings and verdicts; `plain` draws it with ASCII."""
    table = Table(box=box.ASCII2 if plain else box.ROUNDED)
    for heading in _COLUMNS:
        right = heading not in ("recording", "verdict")
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    for each in replayed:
        decision = each.decision
        verdict = Text(decision.verdict, _style(decision.verdict))
        if probable := chance(decision):
            verdict.append(f" {probable}", "default")
        if decision.verdict == Verdict.INCONCLUSIVE:
            verdict.append(f": {advice(decision)}", "default")
        for line in in_passing(decision, each.found):
            verdict.append(f"; {line}", "yellow")
        if each.filter_resets_s:
            verdict.append(f"; {_lost(each)}", "yellow")
        table.add_row(
            Text(each.recording),
            verdict,
            _seconds(decision.onset_s),
            _seconds(each.detected_at_s),
            leak(decision),
            f"{decision.statistic:.1f}/{decision.threshold:.1f}",
        )
    return table


def advice(decision: Decision) -> str:
    """Return what would let a leak be seen where the recording could not show one."""
    if decision.suspected is not None:
        share = percent(decision.probabilities[decision.suspected])
        return (
            f"{decision.suspected} is likely ({share}), but not sure at the stated false-alarm "
            "rate; record for longer, or replay with a baseline of the healthy rig"
        )
    details = decision.details
    travel, needed = details.get("travel_m"), details.get("travel_needed_m")
    if travel is not None and needed is not None and travel < needed:
        return f"move the ram by more than {needed * 1e3:.0f} mm; it moved {travel * 1e3:.1f} mm"
    unseen = {name: details.get(f"smallest_{name}_m3_per_s") for name in LEAKS}
    flows = {name: flow for name, flow in unseen.items() if flow is not None}
    if not flows:
        return "record for longer"
    worst = max(flows, key=lambda name: flows[name])
    flow = to_litres_per_minute(flows[worst])
    return (
        f"{worst} up to {flow:.2g} L/min would not have shown; record for longer, "
        "with larger motion both ways"
    )


def _lost(replayed: Replayed) -> str:
    """Return how often the filter was lost, and when first."""
    first, number = replayed.filter_resets_s[0], len(replayed.filter_resets_s)
    return f"filter lost at {first:.2f} s" + (f", {number} times" if number > 1 else "")


def _style(verdict: str) -> str:
    styles: dict[str, str] = {Verdict.HEALTHY: "green", Verdict.INCONCLUSIVE: "yellow"}
    return styles.get(verdict, "red")


def _seconds(time_s: float | None) -> str:
    return "" if time_s is None else f"{time_s:.2f} s"
