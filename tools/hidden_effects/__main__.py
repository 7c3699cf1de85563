"""Runs the gap workflow on rigs with hidden effects and prints how often it named them right.

    python -m tools.hidden_effects --trials 200 --seed 1 --jobs 2 --out runs/hidden_effects

The workflow gets recordings only, never what is hidden. The rigs are those of
`tools.hidden_effects`, whose simulator shares no code with the model. Every trial is kept as a line
of JSON; after an interruption the same command runs the trials that are missing.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from tools.hidden_effects.drawn_trials import FORM_CHOICES, KINDS, OFF_MENU_CHOICES, SECONDS, Choice
from tools.hidden_effects.forms import CATALOGUE
from tools.hidden_effects.tables import by_effect, by_form, by_place, summary
from tools.hidden_effects.trials import kept_file, plans, run_trials
from tools.hidden_effects.workflow import Workflow, in_process, rig_gap
from tools.pages.marked_tables import fill


def main(arguments: Sequence[str] | None = None, workflow: Workflow = rig_gap) -> None:
    """Run the trials that are not kept from an earlier run, and print the tables of all.

    Args:
        arguments: of the command line; None means those of the program.
        workflow: the function to test, unless `--in-process` is given.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tools.hidden_effects",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--trials", type=int, default=200, help="default 200")
    parser.add_argument("--seed", type=int, default=1, help="draws everything; default 1")
    parser.add_argument("--jobs", type=int, default=2, help="processes; default 2")
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"), metavar="DIR")
    parser.add_argument("--kind", choices=KINDS, help="all trials of one kind; default a mixture")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, help=f"of each recording; default {SECONDS:g}"
    )
    parser.add_argument(
        "--limits",
        type=float,
        default=0.0,
        metavar="TIMES",
        help="hide nothing smaller than so many times what the trial's own motions would show of "
        "it; default the sizes of tools/hidden_effects/sizes.py",
    )
    parser.add_argument(
        "--forms",
        choices=FORM_CHOICES,
        default=CATALOGUE,
        help="formulas of hidden effects on the menu: those of the catalogue (default), or others; "
        "effects that have no other are then left out",
    )
    parser.add_argument(
        "--off-menu",
        choices=OFF_MENU_CHOICES,
        default="first",
        help="what --kind off_menu draws from: the first twelve kinds (default), or all kinds in "
        "all variants",
    )
    parser.add_argument(
        "--in-process", action="store_true", help="without the command rig gap and its report"
    )
    parser.add_argument("--keep", action="store_true", help="leave recordings and reports in DIR")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page whose tables to bring up")
    options = parser.parse_args(arguments)
    choice = Choice(options.forms, options.off_menu)
    planned = plans(
        options.trials, options.seed, options.kind, options.seconds, options.limits, choice
    )
    tried = in_process if options.in_process else workflow
    found = run_trials(planned, options.out, options.jobs, options.keep, tried)
    tables = {
        "hidden_effects": summary(found),
        "hidden_by_effect": by_effect(found),
    }
    if choice.forms != CATALOGUE:
        tables["hidden_by_form"] = by_form(found)
    if choice.off_menu != "first":
        tables["hidden_by_place"] = by_place(found)
    if options.page:
        fill(options.page, tables)
    print("\n\n".join([*tables.values(), f"Trials: {kept_file(options.out)}"]))


if __name__ == "__main__":
    main()
