"""Judges leaks that come and go, and healthy rigs, and prints what the detector made of them.

`python -m tools.intermittent leaks --seed 31 --count 48 --out DIR` judges 48 leaks,
and `least` leaks whose flow times duty is about the least of the condition;
`healthy --seed 31 --hours 2` judges 2 h of healthy independent rigs in runs of ten minutes;
`lanes --seed 3 --hours 8` judges 8 h of the rigs of docs/detection.md from group 3 on, each for
half an hour, and begins anew after an alarm; `steady --count 60` judges leaks of 0.005 to 0.5 L/min
that stay, with the test for returns and without. Finished trials are kept in DIR, and a study that
was interrupted goes on where it stopped.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from math import ceil
from pathlib import Path

from rig.compile_cache import source_key
from rig.lanes import LANES
from tools.counted_shares import counted as counted_share
from tools.detection_limits.study import plans as small_leaks
from tools.intermittent.judging import Outcome, ReturnsJudge, Steady, judge, judge_steady
from tools.intermittent.trials import GATES, SECONDS, least_plans, plans
from tools.kept_trials import kept_trials, run_and_keep
from tools.pages.marked_tables import markdown
from tools.studies.healthy_hours import RUN_S, Setting, run_group

_ROOT = Path(__file__).parents[2]
_HEALTHY_S = 600.0


def outcomes(options: argparse.Namespace) -> list[Outcome]:
    """Return the outcomes of all trials; those that are kept from before are not run again."""
    healthy = options.what == "healthy"
    seconds = _HEALTHY_S if healthy else SECONDS
    if healthy:
        wanted = plans(options.seed, 0, 2 * ceil(options.hours * 3600.0 / seconds))
        wanted = [plan for plan in wanted if plan.independent]
    else:
        draw = least_plans if options.what == "least" else plans
        wanted = draw(options.seed, options.count)
    options.out.mkdir(parents=True, exist_ok=True)
    setting = f"{options.false_alarms_per_day:g}-{options.model_error:g}"
    file = options.out / f"{options.what}-{setting}-{source_key(_ROOT)}.jsonl"
    done = {
        (found.seed, found.number): found for found in (Outcome(**o) for o in kept_trials(file))
    }
    left = [
        (plan, seconds, options.false_alarms_per_day, options.model_error)
        for plan in wanted
        if (plan.seed, plan.number) not in done
    ]
    for found in run_and_keep(file, "trials", judge, left, 1):
        done[found.seed, found.number] = found
    return [done[plan.seed, plan.number] for plan in wanted]


def table(found: Sequence[Outcome]) -> str:
    """Return the table of leaks by place and by what opens them, as Markdown."""
    counted = [each for each in found if each.counts]
    groups: list[tuple[str, Iterable[Outcome]]] = [
        (str(leak).replace("_", " "), [each for each in counted if each.leak == leak])
        for leak in sorted({str(each.leak) for each in counted})
    ]
    groups += [(f"opened by {gate}", [e for e in counted if e.gate == gate]) for gate in GATES]
    groups += [
        ("independent rig", [each for each in counted if each.independent]),
        ("product's rig", [each for each in counted if not each.independent]),
        ("all", counted),
    ]
    rows = [_row(name, list(group)) for name, group in groups]
    heads = ("", "leaks", "so named", "wrong leak", "named after, median", "duty covered",
             "flow covered", "goes with what opens it", "goes with something else")  # fmt: skip
    return markdown(heads, [row for row in rows if row])


def _row(name: str, group: list[Outcome]) -> list[str]:
    if not group:
        return []
    right = [each for each in group if each.right]
    wrong = sum(each.intermittent and each.verdict != each.leak for each in group)
    times = sorted(each.named_s for each in right if each.named_s is not None)
    truly = sum(each.goes_with == each.gate for each in right)
    other = sum(each.goes_with not in (None, "time", each.gate) for each in right)
    return [
        name, str(len(group)), str(len(right)), str(wrong),
        f"{times[len(times) // 2] - 20.0:.0f} s" if times else "–",
        f"{sum(e.duty_low <= e.duty <= e.duty_high for e in right)} of {len(right)}",
        f"{sum(e.flow_low <= e.flow <= e.flow_high for e in right)} of {len(right)}",
        str(truly), str(other),
    ]  # fmt: skip


def print_leaks(found: Sequence[Outcome]) -> None:
    """Print the table, and each trial that counts and is not so named."""
    counted = [each for each in found if each.counts]
    print(table(found))
    share = counted_share(each.right for each in counted)
    print(f"\nso named: {share}; {len(found) - len(counted)} trials outside the condition")
    for each in counted:
        if not each.right:
            print(f"missed: {each}")


def lanes(options: argparse.Namespace) -> None:
    """Run groups of drawn healthy rigs in lanes, and print their alarms of either kind."""
    setting = Setting(options.false_alarms_per_day, options.model_error)
    alarms: Counter[str] = Counter()
    hours = 0.0
    for number in range(options.seed, options.seed + ceil(options.hours * 3600 / (RUN_S * LANES))):
        judges = [
            ReturnsJudge(number * LANES + lane, setting.rate, setting.model_error)
            for lane in range(LANES)
        ]
        hours += run_group(number, setting, watchers=judges).rig_s / 3600.0
        alarms += sum((each.alarms for each in judges), Counter[str]())
        stated = setting.rate * hours / 24.0
        print(
            f"group {number}: {hours:.0f} h, alarms {dict(alarms)}, {stated:.1f} stated", flush=True
        )


def print_steady(options: argparse.Namespace) -> None:
    """Run trials of leaks that stay; print how many decisions the test for returns changed."""
    wanted = [plan for plan in small_leaks(options.count) if plan.fault is not None]
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / f"steady-{source_key(_ROOT)}.jsonl"
    done = {found.seed: found for found in (Steady(**fields) for fields in kept_trials(file))}
    left = [(plan,) for plan in wanted if plan.seed not in done]
    for found in run_and_keep(file, "trials", judge_steady, left, 1):
        done[found.seed] = found
    changed = [each for each in done.values() if not each.same]
    print(f"{len(done)} leaks that stay: {len(changed)} with another decision at any time")
    for each in changed:
        print(each)


def main() -> None:
    """Run the trials that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("leaks", "least", "healthy", "lanes", "steady"))
    parser.add_argument("--seed", type=int, default=31, help="of the trials; first group of lanes")
    parser.add_argument("--count", type=int, default=48, help="leaks (default 48)")
    parser.add_argument("--hours", type=float, default=2.0, help="healthy hours (default 2)")
    parser.add_argument("--false-alarms-per-day", type=float, default=1.0, help="the setting")
    parser.add_argument("--model-error", type=float, default=1.0, help="allowance (default 1)")
    parser.add_argument("--out", type=Path, required=True, help="folder for what was done")
    options = parser.parse_args()
    if options.what == "lanes":
        lanes(options)
        return
    if options.what == "steady":
        print_steady(options)
        return
    found = outcomes(options)
    if options.what in ("leaks", "least"):
        print_leaks(found)
        return
    returning = sum(each.named_s is not None for each in found)
    alarmed = sum(each.alarmed for each in found)
    hours = sum(each.seconds for each in found) / 3600.0
    print(f"{hours:.1f} h: {alarmed} of {len(found)} runs with an alarm, {returning} of a return")


if __name__ == "__main__":
    main()
