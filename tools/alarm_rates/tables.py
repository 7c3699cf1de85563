"""Prints how often healthy rigs were accused, by regime, and how many leaks were named."""

from collections.abc import Sequence

from estimator.learnt import REGIMES
from rig.plant import LEAKS
from tools.alarm_rates.judging import RATES, SIZES, Judged
from tools.counted_shares import counted
from tools.pages.marked_tables import markdown
from tools.studies.healthy_hours import poisson_interval

_DAY_S = 86400.0


def alarm_table(found: Sequence[Judged]) -> str:
    """Return alarms by setting and regime beside what was set, as Markdown.

    Intervals are exact for Poisson counts (Garwood 1936), 95 %.
    """
    rows = []
    for rate in RATES:
        for regime in ("all", *REGIMES):
            seconds = sum(
                time for each in found for name, time in each.seconds.items()
                if regime in ("all", name)
            )  # fmt: skip
            if not seconds:
                continue
            days = seconds / _DAY_S
            alarms = sum(
                alarm.rate == rate and regime in ("all", alarm.regime)
                for each in found for alarm in each.alarms
            )  # fmt: skip
            low, high = (bound / days for bound in poisson_interval(alarms))
            rows.append(
                [
                    f"{rate:g}", regime.replace("_", " "), f"{seconds / 3600.0:.2f}", str(alarms),
                    f"{rate * days:.1f}", f"{alarms / days:.0f}", f"{low:.1f} to {high:.0f}",
                ]
            )  # fmt: skip
    heads = ("set, a day", "regime", "hours", "alarms", "by the setting", "a day", "95 %")
    return markdown(heads, rows)


def leak_table(found: Sequence[Judged]) -> str:
    """Return how many leaks were named in time, by place and size, as Markdown."""
    rows = []
    for size, within_s in SIZES:
        for leak in LEAKS:
            sought = [s for each in found for s in each.leaks if (s.size, s.leak) == (size, leak)]
            if sought:
                other = sum(each.other for each in sought)
                rows.append(
                    [
                        f"{size:g}", f"{within_s:g} s", leak.replace("_", " "),
                        counted(each.named for each in sought), str(other),
                    ]
                )  # fmt: skip
    return markdown(("L/min", "within", "leak", "named in time", "something else first"), rows)


def stated_table(found: Sequence[Judged]) -> str:
    """Return the alarms of each setting beside the intervals that the baselines stated."""
    rows = []
    for rate in RATES:
        stated = [each for rig in found for each in rig.expected if each[0] == rate]
        low = sorted(each[1] for each in stated)[len(stated) // 2]
        high = sorted(each[2] for each in stated)[len(stated) // 2]
        rows.append([f"{rate:g}", str(len(stated)), f"{low:.1f} to {high:.0f}"])
    return markdown(("set, a day", "baselines", "stated, median of the ends"), rows)
