"""Measures how often rigs of another maker alarm with a baseline, and how small a leak is named.

`python -m tools.alarm_rates --seed 2000 --rigs 12 --out DIR` draws 12 rigs of the independent
simulator, gives each six recordings of ten minutes, learns a baseline from three of them, judges
the other three with it at 100 and at 10 alarms a day, and the other way round, and looks for leaks
of 0.03 and 0.015 L/min. `--minutes 20` makes the baselines an hour long. Finished rigs and their
accounts are kept in DIR until the sources of the product or of the simulator change; a run that was
interrupted goes on where it stopped. A rig-hour takes some 30 s of a processor to simulate and 30 s
to judge.
"""

import argparse
import os
from pathlib import Path

from tools.alarm_rates.judging import Alarm, Judged, Sought, judged_rig
from tools.alarm_rates.tables import alarm_table, leak_table, stated_table
from tools.hidden_effects.trials import sources_digest
from tools.kept_trials import kept_trials, run_and_keep


def main() -> None:
    """Run the trials that are not kept yet, and print the tables of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=2000, help="of the first rig (default 2000)")
    parser.add_argument("--rigs", type=int, default=12, help="number of rigs (default 12)")
    parser.add_argument("--leaks", type=int, default=1, help="of each kind a recording (default 1)")
    parser.add_argument("--minutes", type=float, default=10.0, help="of a recording (default 10)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--out", type=Path, required=True, help="folder for what was done")
    options = parser.parse_args()
    # Small matrices gain nothing from threads of their own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options.out.mkdir(parents=True, exist_ok=True)
    sources = sources_digest()
    file = options.out / f"rigs-{options.minutes:g}-{options.leaks}-{sources}.jsonl"
    done = {each.seed: each for each in map(_read, kept_trials(file))}
    seeds = range(options.seed, options.seed + options.rigs)
    left = [
        (seed, options.out / f"accounts-{sources}", options.leaks, 60.0 * options.minutes)
        for seed in seeds
        if seed not in done
    ]
    for each in run_and_keep(file, "rigs", judged_rig, left, options.jobs):
        done[each.seed] = each
    found = [done[seed] for seed in seeds]
    for table in (alarm_table(found), stated_table(found), leak_table(found)):
        print(table, end="\n\n")


def _read(fields: dict[str, object]) -> Judged:
    judged = Judged(**fields)  # type: ignore[arg-type]
    return Judged(
        judged.seed,
        judged.seconds,
        [Alarm(*each) for each in judged.alarms],
        [Sought(*each) for each in judged.leaks],
        [(each[0], each[1], each[2]) for each in judged.expected],
    )


if __name__ == "__main__":
    main()
