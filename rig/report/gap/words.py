"""Puts the result of a gap search into words: what is missing, how much, how sure, and rivals."""

from collections.abc import Iterator
from math import ceil, floor, isfinite, log10
from typing import Final

from estimator.gap import (
    NOWHERE,
    Band,
    ChannelGap,
    Curve,
    DetectionLimit,
    Discovered,
    Estimate,
    GapResult,
    NamedEffect,
    Round,
)

VERDICT_WORDS: Final = {
    "adequate": "The model is adequate",
    "missing_effect": "The model lacks an effect",
    "unknown_effect": "Something is missing that the catalogue does not have",
    "inconclusive": "These recordings do not tell",
}
_ALL: Final = 0.98
"""Part of the excess from which on all of it counts as explained."""
_TRIFLE: Final = 0.1
"""Noise variances. The page says neither where a smaller gap is, nor that a gap varies by less."""
_SOME: Final = 0.1
"""Least part of what is left that a place must explain so that the page names it."""
_PREFIXES: Final = {
    "Pa": (("MPa", 1e-6), ("kPa", 1e-3), ("Pa", 1.0)),
    "m": (("m", 1.0), ("mm", 1e3), ("um", 1e6)),
    "s": (("s", 1.0), ("ms", 1e3), ("us", 1e6)),
    "N/m": (("MN/m", 1e-6), ("kN/m", 1e-3), ("N/m", 1.0)),
    "m/s": (("m/s", 1.0), ("mm/s", 1e3)),
}
"""For an SI unit, the units in which a value may be shown, largest first, with their factors; a
value in another unit is shown in SI."""


def in_words(name: str) -> str:
    """Return a name of the catalogue with spaces in place of underscores."""
    return name.replace("_", " ")


def unit_for(value: float, unit: str) -> tuple[str, float]:
    """Return the unit in which to show a value in SI, and the factor to multiply the value by.

    It is the largest unit in which the value is at least 1, else the smallest.
    """
    choices = _PREFIXES.get(unit, ((unit, 1.0),))
    for name, factor in choices:
        if abs(value) * factor >= 1.0:
            return name, factor
    return choices[-1]


def number(value: float, digits: int = 3) -> str:
    """Return a number as text with `digits` significant digits; "not known" if it is not finite.

    A power of ten is used only below 1e-3 and from 1e5 on.
    """
    if not isfinite(value):
        return "not known"
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - floor(log10(abs(value))) if value else 0
    return f"{value:.{max(decimals, 0)}f}"


def with_unit(value: float, unit: str) -> str:
    """Return a value in SI as text in a convenient unit, with the unit."""
    shown, factor = unit_for(value, unit)
    return f"{number(value * factor)} {shown}".strip()


def estimated(estimate: Estimate) -> str:
    """Return an estimate as text: value ± half the width of its 95 % interval, and the unit.

    The half width is left out if it is not finite or not positive.
    """
    half = (estimate.upper - estimate.lower) / 2.0
    shown, factor = unit_for(estimate.value or half, estimate.unit)
    value, half = estimate.value * factor, half * factor
    if not isfinite(half) or half <= 0.0:
        return f"{number(value)} {shown}".strip()
    place = floor(log10(half) + 1e-9) - 1
    power = floor(log10(max(abs(value), half)))
    if power < -3 or power > 5:
        scale = 10.0**power
        decimals = max(power - place, 0)
        text = f"({value / scale:.{decimals}f} ± {half / scale:.{decimals}f})e{power}"
    else:
        text = f"{value:.{max(-place, 0)}f} ± {half:.{max(-place, 0)}f}"
    return f"{text} {shown}".strip()


def sizes(effect: NamedEffect) -> str:
    """Return the estimates of an effect's parameters as one phrase, with names if several."""
    if len(effect.parameters) == 1:
        return estimated(effect.parameters[0])
    return ", ".join(f"{in_words(each.key)} {estimated(each)}" for each in effect.parameters)


def or_else(effect: NamedEffect) -> str:
    """Return an effect's name, followed by the effects that cannot be distinguished from it."""
    others = [in_words(rival.effect) for rival in effect.indistinguishable]
    return " or ".join([in_words(effect.name), *others])


def shrunk(result: GapResult) -> float:
    """Return the share by which the held-out error above the floor fell; NaN if there was none.

    It is negative if the error grew.
    """
    if not result.gap_before > 0.0:
        return float("nan")
    return 1.0 - result.gap_after / result.gap_before


def _named(effect: NamedEffect) -> str:
    """Return an effect's name with its size and the effects it cannot be distinguished from."""
    others = " or ".join(in_words(rival.effect) for rival in effect.indistinguishable)
    rivals = f" (or {others}: these recordings cannot tell)" if others else ""
    return f"{in_words(effect.name)}, {sizes(effect)}{rivals}"


def extent(each: Discovered) -> str:
    """Return how large a discovered disturbance is, as text.

    These are its estimated numbers, else the least and the greatest value of its table; the text is
    empty if it has neither.
    """
    if each.estimates:
        return ", ".join(f"{in_words(one.key)} {estimated(one)}" for one in each.estimates)
    if each.curve is None:
        return ""
    unit, factor = each.curve.shown
    low, high = (number(float(end) * factor) for end in (min(each.values), max(each.values)))
    return f"{low} to {high} {unit}".strip()


def knots(each: Discovered) -> Iterator[tuple[str, str]]:
    """Yield position and value of each knot of a discovered table, as texts without units.

    They are in the units in which the table's curve is shown; the value has its 95 % interval.
    Nothing is yielded for a disturbance without a curve.
    """
    if each.curve is None:
        return
    factor, of_factor = each.curve.shown[1], each.curve.region_shown[1]
    for at, value, error in zip(each.at, each.values, each.errors, strict=True):
        half = 1.96 * float(error) * factor
        interval = f" ± {number(half, 2)}" if isfinite(half) else ""
        yield number(float(at) * of_factor), f"{number(float(value) * factor)}{interval}"


def _discovered(result: GapResult) -> str:
    """Return what was discovered, as words for the middle of a sentence.

    A single disturbance beside which no effect was named is described in full; of others all but
    the figures that follow a colon.
    """
    whats = [f"{each.what[0].lower()}{each.what[1:]}" for each in result.discovered]
    if len(whats) == 1 and not result.effects:
        return whats[0]
    return "; ".join(what.partition(":")[0] for what in whats)


def _explains(result: GapResult) -> str:
    """Return words on which share of the excess all named effects and discoveries explain.

    They begin with the full stop of the sentence before; "" if the share is 98 % or more, or not
    known.
    """
    if not (isfinite(result.accounted) and result.accounted < _ALL):
        return ""
    return f". This explains {share(result.accounted)} of the excess, nothing known the rest"


def headline(result: GapResult) -> str:
    """Return the result of a gap search in one sentence, or two if something stays unexplained."""
    if result.verdict == "missing_effect":
        named = "; ".join(_named(each) for each in result.effects)
        besides = f"; besides, {_discovered(result)}" if result.discovered else ""
        return f"The model lacks {named}{besides}{_explains(result)}."
    if result.verdict == "unknown_effect" and result.discovered:
        return f"{VERDICT_WORDS[result.verdict]}: {_discovered(result)}{_explains(result)}."
    if result.verdict == "unknown_effect":
        curve = result.rest[0] if result.rest else None
        if curve is None or curve.share < NOWHERE:
            return (
                "Something is missing that neither an effect of the catalogue nor a steady "
                "disturbance of one equation explains."
            )
        return (
            f"A disturbance of the {curve.equation} that goes with the {curve.region} is missing, "
            "and no effect of the catalogue explains it."
        )
    if result.verdict == "inconclusive":
        return "These recordings cannot support a verdict."
    return "Nothing is missing that these recordings could show."


def gap_words(result: GapResult) -> str:
    """Return the prediction error on the held-out recordings, before and after, in one sentence.

    By how much the error after varies by chance is told if it is more than `_TRIFLE`.
    """
    before, after, chance = result.gap_before, result.gap_after, result.gap_scatter
    if not isfinite(before):
        return "The held-out prediction error was not computed."
    words = f"Held-out prediction error above the noise floor: {number(before)} noise variances"
    if result.as_given:
        return f"{words}; the model is written as given."
    words = f"{words} before, {number(after)} after"
    if chance > _TRIFLE:
        words += f" (which varies by {number(chance)} by chance)"
    part = shrunk(result)
    if (result.effects or result.discovered) and isfinite(part) and part > 0.0:
        return f"{words}; {floor(1000.0 * part) / 10.0:g} % of it is gone."
    return f"{words}."


def left_words(result: GapResult) -> Iterator[str]:
    """Yield one sentence on the held-out prediction error that the model as written leaves.

    It gives the error above the floor, the rms error of each channel with its unit, and where the
    error is, unless the error is small or no place has a tenth of it. Nothing is yielded if the
    error was not measured.
    """
    if not (result.channels and isfinite(result.gap_after)):
        return
    channels = ", ".join(
        f"{channel(gap.channel)} {with_unit(gap.rms_after, gap.unit)}" for gap in result.channels
    )
    words = (
        f"What is left: {excess(result.gap_after)} noise variances above the floor, as rms "
        f"{channels}"
    )
    curve = result.rest[0] if result.rest else None
    if result.gap_after < _TRIFLE or curve is None or not curve.share > _SOME:
        yield f"{words}."
        return
    yield (
        f"{words}; of what is left in the recordings fitted to, {share(curve.share)} goes with the "
        f"{curve.region}, in the {curve.equation}."
    )


def found_in(ended: Round) -> str:
    """Return in words what a round found to be missing; its verdict if it found nothing."""
    named = [f"{or_else(each)}, {sizes(each)}" for each in ended.effects]
    named += [f"{in_words(each.name)} in {each.where}" for each in ended.discovered]
    return "; ".join(named) or VERDICT_WORDS[ended.verdict].lower()


def checked_in(ended: Round) -> str:
    """Return in words the result of a round's check, or why there was none."""
    check = ended.check
    if check is None:
        return "not checked: " + (
            "there was nothing to revise"
            if not (ended.effects or ended.discovered)
            else "it could be settled first which effect it is"
        )
    lacks = [*map(in_words, check.effects), *check.discovered]
    missing = f": {', '.join(lacks)}" if lacks else ""
    return (
        f"{VERDICT_WORDS[check.verdict].lower()}{missing}; error above the noise floor "
        f"{number(check.gap_before)} before, {number(check.gap_after)} after, noise variances"
    )


def where_words(curve: Curve) -> str:
    """Return a phrase on a disturbance: its equation and region, its largest value and its share.

    The largest value is the one of largest magnitude, with its 95 % interval and its place.
    """
    index = max(range(len(curve.values)), key=lambda i: abs(float(curve.values[i])))
    unit, factor = curve.shown
    region_unit, region_factor = curve.region_shown
    value = number(float(curve.values[index]) * factor)
    error = number(1.96 * float(curve.errors[index]) * factor, 2)
    at = number(float(curve.at[index]) * region_factor)
    return (
        f"{curve.equation} against {curve.region}: up to {value} ± {error} {unit} at {at} "
        f"{region_unit}; this would take away {share(curve.share)} of the excess"
    )


def share(part: float) -> str:
    """Return a fraction as text in percent, limited to 0 to 100; "no known part" if not finite."""
    return f"{min(max(100.0 * part, 0.0), 100.0):.0f} %" if isfinite(part) else "no known part"


def channel(name: str) -> str:
    """Return a channel's name in words, without the unit at its end."""
    return in_words(name.rsplit("_", 1)[0]) if "_" in name else name


def band(of: Band) -> str:
    """Return a frequency band in words."""
    return f"{of.low:g} to {of.high:g} Hz"


def band_shares(gap: ChannelGap) -> list[str]:
    """Return each frequency band's share of a channel's error above the floor, as text.

    The error is the one-step prediction error of the model as given. The texts are "none" if no
    band has an error above the floor.
    """
    excesses = [max(each.before - each.floor, 0.0) for each in gap.bands]
    total = sum(excesses)
    return [share(each / total) if total > 0.0 else "none" for each in excesses]


def excess(variances: float) -> str:
    """Return an error above the floor, in noise variances, as text; a negative one becomes zero."""
    return number(max(variances, 0.0))


def held_out(effect: NamedEffect) -> str:
    """Return in words what the held-out recordings say of a named effect.

    It is "confirmed", with the effect's z, or "not shown by the motion" if z is not finite.
    """
    if not isfinite(effect.held_out_z):
        return "not shown by the motion"
    return f"confirmed, z = {effect.held_out_z:.1f}"


def limit(smallest: DetectionLimit) -> str:
    """Return the smallest size at which an effect would have been found, as text with its unit.

    It is rounded up to 2 digits. A size that is not finite, or not above zero, gives words instead.
    """
    if not isfinite(smallest.size):
        return "no plausible size"
    if smallest.size <= 0.0:
        return "not by these motions"
    scale = 10.0 ** (floor(log10(smallest.size)) - 1)
    return with_unit(ceil(smallest.size / scale - 1e-9) * scale, smallest.unit)
