"""Shares that are counted in trials, with their 95 % intervals."""

from collections.abc import Iterable

from scipy.stats import beta


def interval(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of the share `count / of`, by Clopper and Pearson (1934)."""
    low = float(beta.ppf(0.025, count, of - count + 1)) if count > 0 else 0.0
    high = float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0
    return low, high


def counted(flags: Iterable[bool]) -> str:
    """Return the text "n of m" for n True among m flags, with the share's 95 % interval in %.

    It is a dash if there are no flags.
    """
    found = list(flags)
    if not found:
        return "–"
    low, high = interval(sum(found), len(found))
    return f"{sum(found)} of {len(found)} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"
