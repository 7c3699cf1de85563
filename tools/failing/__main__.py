"""Lets each call site fail once in turn, simulated and emulated, and writes docs/failing.md.

Run as `python -m tools.failing [--rig RIG] [--all] [--sites N] [--seed S] [TEXT ...]`. On the
simulated rig all sites are tried, on the emulated one N of them, drawn by the seed, or all of them
with `--all`, in an order that is drawn. With texts, only sites whose names contain one of them are
tried; `memory` stands for the steps of the address space. With `--results FILE` each failure that
was tried is added to a file, so that the same command goes on after a kill with the next one. A
rig's table is written if no texts are given and nothing failed.
"""

import argparse
import random
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from tools.chaos.signals import end_by_signals
from tools.chaos.stage import StageError
from tools.pages.marked_tables import fill

from .emulated import EmulatedTrials
from .injection import Site
from .results import Results
from .tables import PAGE, table_of
from .trying import SimulatedTrials, Tried, named, of_address_space

RIGS: Final = ("simulated", "emulated")
SAMPLE: Final = 12
"""Sites that are tried on the emulated rig unless all are: each takes half a minute."""
MIB: Final = 1 << 20
SIMULATED_MIB: Final = tuple(range(100, 1700, 200))
"""Limits of the address space on the simulated rig, in MiB: from less than the interpreter and
numpy need to more than a whole run does, which is some 1300 MiB with the compiler's library."""
EMULATED_MIB: Final = (500, 1000, 1500, 2048, 2300, 2600, 3000)
"""The same on the emulated rig, around the limit below which a session does not begin
(`ADDRESS_SPACE_BYTES` in `rig/reserves.py`)."""

Failure = tuple[Site, int]
"""A site, and how often it is reached before it fails."""
Trial = tuple[str, Callable[[], Tried | None]]
"""The name of a failure, and what lets it happen and returns what came of it; None if it was not
reached this time."""


def main() -> int:
    """Try the failures that are asked for; return how many were not as they should be."""
    parser = argparse.ArgumentParser(prog="python -m tools.failing", description=__doc__)
    parser.add_argument("--rig", choices=RIGS, help="one of them only (default: both)")
    parser.add_argument("--all", action="store_true", help="all sites on the emulated rig, too")
    sites = "number of sites on the emulated rig (default: %(default)s)"
    parser.add_argument("--sites", type=int, default=SAMPLE, help=sites)
    seed = "of the draw of these sites (default: %(default)s)"
    parser.add_argument("--seed", type=int, default=1, help=seed)
    results = "file to which each failure is added, and whose failures are not tried again"
    parser.add_argument("--results", type=Path, help=results)
    texts = "a part of the name of a site to try (default: all)"
    parser.add_argument("texts", nargs="*", metavar="TEXT", help=texts)
    given = parser.parse_args()
    end_by_signals()
    known = Results(given.results)
    failed = 0
    for rig in RIGS if given.rig is None else (given.rig,):
        sample = None if given.all or rig == "simulated" else given.sites
        with tempfile.TemporaryDirectory(prefix="rig-failing-") as folder:
            try:
                total, trials = _planned(rig, Path(folder), given.texts, sample, given.seed)
            except StageError as error:
                print(f"FAILED {rig}: {error}")
                return 1
            print(f"{rig}: {len(trials)} of {total} failures", flush=True)
            tried = []
            for name, trial in trials:
                result = known.of(rig, name, trial)
                if result is not None:
                    tried.append(result)
                    print(_told(result), flush=True)
        wrong = sum(bool(each.problems) for each in tried)
        table = table_of(tried, total)
        print(f"{table}\n{wrong} failed")
        if not (wrong or given.texts):
            fill(PAGE, {rig: table})
        failed += wrong
    return min(failed, 1)


def _planned(
    rig: str, folder: Path, texts: list[str], sample: int | None, seed: int
) -> tuple[int, list[Trial]]:
    """Return how many failures there are on a rig, and the trials of those that are chosen.

    Raises:
        StageError: an untroubled run on the emulated rig does not come to its end.
    """
    memory = not texts or "memory" in texts
    if rig == "simulated":
        simulated = SimulatedTrials(folder)
        warm, cold = simulated.sites()
        trials: list[Trial] = [
            (named(*each), partial(simulated.tried, *each)) for each in _failures(warm, texts)
        ]
        trials += [
            (named(*each), partial(simulated.tried, *each, cold=True))
            for each in _failures(cold, texts)
        ]
        limits = SIMULATED_MIB if memory else ()
        trials += [_of_memory(simulated.with_address_space, each) for each in limits]
        return len(trials), trials
    emulated = EmulatedTrials(folder)
    chosen = _failures(emulated.sites(), texts)
    total = len(chosen) + (len(EMULATED_MIB) if memory else 0)
    limits = EMULATED_MIB if memory else ()
    if sample is not None and sample < len(chosen):
        chosen = random.Random(seed).sample(chosen, sample)
        limits = limits[::3]
    elif not texts:
        # Those that were tried before a long play was broken off are then a sample of all.
        random.Random(seed).shuffle(chosen)
    trials = [(named(*each), partial(emulated.tried, *each)) for each in chosen]
    trials += [_of_memory(emulated.with_address_space, each) for each in limits]
    return total, trials


def _of_memory(trial: Callable[[int], Tried], mebibytes: int) -> Trial:
    limit = mebibytes * MIB
    return of_address_space(limit), partial(trial, limit)


def _failures(sites: dict[Site, int], texts: list[str]) -> list[Failure]:
    """Return the failures of sites: the first time that each is reached, and the last time.

    Threads differ in how often they reach a place, so that the last time is that before the last
    one in an untroubled run, of those places that are reached more than twice.
    """
    named = [site for site in sites if not texts or any(text in str(site) for text in texts)]
    return [
        (site, after)
        for site in named
        for after in ((0, sites[site] - 2) if sites[site] > 2 else (0,))
    ]


def _told(tried: Tried) -> str:
    head = "FAILED" if tried.problems else "ok"
    codes = tried.exit_code if tried.resumed is None else f"{tried.exit_code}, {tried.resumed}"
    found = f"; {'; '.join(tried.problems)}; told: {tried.told}" if tried.problems else ""
    return f"{head}: {tried.name}: exit code {codes}{found}"


if __name__ == "__main__":
    sys.exit(main())
