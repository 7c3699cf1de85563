r"""Compares `rig gap` with sparse regression and Gaussian processes on the same recordings.

    python -m tools.peers --shared ../shared/data/gap --hidden 10 --seed 29 --oscillators 20 \
        --out runs/peers --page docs/peers.md

Needs the extra `peers`. Each case is kept as a line of JSON; after an interruption the same command
runs the cases that are missing.
"""

import argparse
import sys
from collections.abc import Sequence
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Final

import rig
from rig.compile_cache import source_key, use_compile_cache
from rig.runner.outcomes import git_state
from tools.hidden_effects.drawn_trials import KINDS
from tools.kept_trials import kept_trials, run_and_keep
from tools.pages.marked_tables import fill
from tools.peers.cases import Plan, hidden_plans, listed_plans, oscillator_plans, shared_plans
from tools.peers.compare import METHODS, Compared, compared, compared_of
from tools.peers.optional import MissingPeerError, needed
from tools.peers.tables import by_case, summary

_ROOT: Final = Path(__file__).parents[2]
GROUPS: Final = ("shared", "hidden", "oscillators", "listed")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases that are not kept from an earlier run, and print the tables of all.

    Args:
        arguments: of the command line; None means those of the program.

    Returns:
        The exit code: 0, or 2 if a package is missing.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tools.peers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--shared", type=Path, metavar="DIR", help="folder of the shared cases")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="of the shared cases only these")
    parser.add_argument("--hidden", type=int, default=0, metavar="N", help="trials of each kind")
    parser.add_argument(
        "--kinds", nargs="+", choices=KINDS, default=["single", "off_menu"], help="of these trials"
    )
    parser.add_argument("--seconds", type=float, default=15.0, help="of each of their recordings")
    parser.add_argument(
        "--limits", type=float, default=3.0, metavar="TIMES",
        help="hide nothing smaller than so many times what the motions would show; default 3",
    )  # fmt: skip
    parser.add_argument("--oscillators", type=int, default=0, metavar="N", help="how many")
    parser.add_argument(
        "--cases", type=Path, metavar="FILE", help="YAML file that lists cases, such as machines"
    )
    parser.add_argument("--seed", type=int, default=1, help="draws trials and oscillators")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--out", type=Path, default=Path("runs/peers"), metavar="DIR")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page whose tables to bring up")
    options = parser.parse_args(arguments)
    try:
        needed("pysindy")
        needed("sklearn", "scikit-learn")
    except MissingPeerError as missing:
        print(missing, file=sys.stderr)
        return 2
    use_compile_cache()
    found = _run(_plans(options), options.out, options.methods)
    tables = {"peers": summary(found)}
    for group in GROUPS:
        of_group = [each for each in found if each.plan.group == group]
        if of_group:
            tables[f"peers_{group}"] = by_case(of_group)
    tables["peers_made"] = _made(sys.argv[1:] if arguments is None else arguments)
    if options.page:
        fill(options.page, tables)
    print("\n\n".join([*tables.values(), f"Cases: {kept_file(options.out)}"]))
    return 0


def _plans(options: argparse.Namespace) -> list[Plan]:
    plans: list[Plan] = []
    if options.shared:
        plans += shared_plans(options.shared, options.only)
    for kind in options.kinds if options.hidden else ():
        plans += hidden_plans(kind, options.hidden, options.seed, options.seconds, options.limits)
    plans += oscillator_plans(options.oscillators, options.seed)
    return plans + (listed_plans(options.cases) if options.cases else [])


def kept_file(out: Path) -> Path:
    """Return the file in `out` that keeps cases; its name changes with product and this tool."""
    digest = sha256(source_key(_ROOT).encode())
    for path in sorted((_ROOT / "tools/peers").glob("*.py")):
        digest.update(path.read_bytes())
    return out / f"cases-{digest.hexdigest()[:12]}.jsonl"


def _run(plans: Sequence[Plan], out: Path, methods: Sequence[str]) -> list[Compared]:
    """Return the comparisons of all plans, in their order; run those that are not kept.

    A kept case counts if it has all the methods that are asked for.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = kept_file(out)
    done = {each.plan.key: each for each in map(compared_of, kept_trials(file))}
    done = {key: each for key, each in done.items() if set(methods) <= set(each.outcomes)}
    left = [
        (plan, out / f"case-{place:04d}", tuple(methods))
        for place, plan in enumerate(plans)
        if plan.key not in done
    ]
    done |= {each.plan.key: each for each in run_and_keep(file, "peers", compared, left, 1)}
    return [done[plan.key] for plan in plans]


def _made(arguments: Sequence[str]) -> str:
    """Return the sentence that says by what the tables were made."""
    state = git_state(Path(rig.__file__).parent) or {"commit": "unknown", "dirty": False}
    commit = state["commit"][:12] + (" with changes" if state["dirty"] else "")
    packages = ", ".join(f"{name} {version(name)}" for name in ("pysindy", "scikit-learn"))
    return f"Made by `python -m tools.peers {' '.join(arguments)}`, commit {commit}, {packages}."


if __name__ == "__main__":
    sys.exit(main())
