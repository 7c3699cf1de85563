"""Puts parts of an outcome into words, for screen and page: probability, other faults, reaction."""

from collections.abc import Sequence
from dataclasses import replace

from estimator.encoder import EncoderDrift
from estimator.intermittent import Company, Intermittent
from estimator.leaks import Decision, Found, Growth, is_of
from faults import to_litres_per_minute

from .outcome import TestOutcome


def chance(decision: Decision) -> str:
    """Return the verdict's probability in percent; empty if the detector gives none for it."""
    share = decision.probabilities.get(decision.verdict)
    return "" if share is None else percent(share)


def percent(share: float) -> str:
    """Return a probability, 0 to 1, as text in percent; above 0.999 the text is "> 99.9 %".

    Above 0.9 the percentage has one decimal, else none.
    """
    if share > 0.999:
        return "> 99.9 %"
    return f"{100.0 * share:.1f} %" if share > 0.9 else f"{100.0 * share:.0f} %"


def in_passing(decision: Decision, found: Sequence[Found]) -> list[str]:
    """Return clauses, for a reader, on what the final verdict alone does not show.

    They say how a leak grows, how fast the encoder drifts, what else may be the cause, that the
    verdict's fault comes and goes or has ended, if so, and which other faults were confirmed, each
    with its times. The list is empty if there is nothing of that.

    Args:
        decision: the final decision.
        found: all faults that the verdicts named during the test.
    """
    clauses = []
    if decision.growth is not None:
        clauses.append(grows(decision.growth))
    if decision.drift is not None:
        clauses.append(drifts(decision.drift, decision.could_also_be))
    if decision.returns is not None:
        clauses.append(comes_and_goes(decision.returns))
    if decision.ended_s is not None:
        clauses.append(last_seen(decision.ended_s, comes_and_goes=decision.returns is not None))
    return clauses + others_found(decision, found)


def last_seen(ended_s: float, *, comes_and_goes: bool) -> str:
    """Return in words until when a fault was there; one that comes and goes may open again.

    Args:
        ended_s: when the fault, or its last opening, ended, in s of the test.
        comes_and_goes: whether the fault comes and goes.
    """
    if comes_and_goes:
        return f"last open until {ended_s:.1f} s"
    return f"gone again at {ended_s:.1f} s"


def others_found(decision: Decision, found: Sequence[Found]) -> list[str]:
    """Return a clause for each confirmed fault besides the verdict's, with its times.

    The arguments are those of `in_passing`.
    """
    clauses = []
    for each in found:
        held = each.decision
        if not each.confirmed or is_of(decision, replace(held, ended_s=each.ended_s)):
            continue
        began = "" if held.onset_s is None else f" from {held.onset_s:.1f} s"
        ended = "" if each.ended_s is None else f" to {each.ended_s:.1f} s"
        clauses.append(f"{held.verdict.replace('_', ' ')}{began}{ended}")
    return clauses


def onset_shown(decision: Decision | None) -> float | None:
    """Return the onset of what was found, s; None without one, and of a leak without an onset.

    A leak that grows over minutes has no onset. That of a decision on it is where a constant leak
    fits best.
    """
    if decision is None or (decision.growth is not None and decision.growth.since_s is None):
        return None
    return decision.onset_s


def grows(growth: Growth) -> str:
    """Return in words from what to what flow a leak grew, in which time, and whether it grows on.

    It is the only place of these words, for screen, report and live stream.
    """
    now, now_half = growth.now_m3_per_s, 1.96 * growth.now_std_m3_per_s
    rate, rate_half = 60.0 * growth.rate_m3_per_s2, 60.0 * 1.96 * growth.rate_std_m3_per_s2
    began, now, now_half, rate, rate_half = map(
        to_litres_per_minute, (growth.from_m3_per_s, now, now_half, rate, rate_half)
    )
    grew = (
        f"grew from {began:.3f} to {now:.3f} ± {now_half:.3f} L/min within {growth.seconds:.0f} s"
    )
    if not growth.grows_on:
        return grew
    return f"{grew}, and grows on by {rate:.3f} ± {rate_half:.3f} L/min a minute"


def drifts(drift: EncoderDrift, could_also_be: Sequence[str]) -> str:
    """Return in words how fast the encoder drifts, or which causes the verdict is not told from.

    Args:
        drift: the drift that stands out from the accounts.
        could_also_be: `Decision.could_also_be`; empty if the verdict is the drift.
    """
    half = 1.96e3 * drift.deviation_m_per_s
    rate = f"{1e3 * drift.rate_m_per_s:+.1f} ± {half:.1f} mm/s"
    if not could_also_be:
        return f"the encoder's reading runs away from the ram by {rate}"
    names = " or ".join(name.replace("_", " ") for name in could_also_be)
    return f"may be {names}; a drift of the encoder would be {rate}"


def comes_and_goes(found: Intermittent) -> str:
    """Return in words how often a leak opens, for what share of the time, and what it goes with."""
    low, high = (100.0 * share for share in found.duty_interval)
    text = (
        f"comes and goes, open {100.0 * found.duty:.0f} % of the time ({low:.0f} to {high:.0f} %), "
        f"{found.openings} times"
    )
    with_ = found.goes_with
    return text if with_ is None else f"{text}, {_company(with_)}"


def _company(with_: Company) -> str:
    if with_.what == "time":
        return f"every {with_.period_s:.1f} s"
    if with_.what == "direction":
        text = f"while the ram {'extends' if with_.sense > 0 else 'retracts'}"
    else:
        side = "above" if with_.sense > 0 else "below"
        value = with_.beyond or 0.0
        where = f"{1e3 * value:.0f} mm" if with_.what == "position" else f"{1e-6 * value:.2f} MPa"
        text = f"where {with_.what.replace('_', ' ')} is {side} {where}"
    if with_.others:
        text += f" (or as {' or '.join(each.replace('_', ' ') for each in with_.others)} does)"
    return text


def reaction(test: TestOutcome) -> str:
    """Return in words what the loop did about a fault, and when; empty if it did nothing."""
    if not test.actions:
        return ""
    first, last = test.actions[0], test.actions[-1]
    if first.holds:
        return f"held from {first.at_s:.1f} s on"
    until = "on" if last.until_s is None else f"to {last.until_s:.1f} s"
    return f"tolerated from {first.at_s:.1f} s {until}"
