"""`rig gap` finds where a model and recordings disagree, and what the model lacks."""

import os
from pathlib import Path
from typing import Any, Final

import click

from rig.cli.first_compiling import first_compiling
from rig.cli.option_types import STREAMED, paced

HOLDOUT: Final = "--holdout"


class ManyHeldOut(click.Command):
    """A command that takes several recordings after one `--holdout`, so that `held_*.csv` works."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, with `--holdout` repeated before each recording that follows it."""
        repeated: list[str] = []
        held = False
        for place, word in enumerate(args):
            if word.startswith("-"):
                held = word == HOLDOUT
            elif held and args[place - 1] != HOLDOUT:
                repeated.append(HOLDOUT)
            repeated.append(word)
        return super().parse_args(ctx, repeated)


@click.command(cls=ManyHeldOut)
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]")
@click.option(
    HOLDOUT,
    "holdout",
    multiple=True,
    metavar="RECORDING...",
    help="To judge with; nothing is fitted to these.",
)
@click.option("--live", is_flag=True, help="Make the recordings on a rig, and settle what is open.")
@click.option("--rig", metavar="RIG", help="Of --live: the rig.")
@paced("Of --live: at")
@STREAMED
@click.option(
    "--rounds",
    type=click.IntRange(1, 20),
    help="Of --live: at most; 4 if not given.",
)
@click.option("--dry-run", is_flag=True, help="Of --live: show the motions, and move nothing.")
@click.option("--model", default="nominal", show_default=True, help="The model to be tested.")
@click.option(
    "--plant",
    "outside",
    metavar="MODULE:OBJECT",
    help="A plant of your own, described in Python; --model is then its YAML file.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for model.yaml, report.html and gap.json; made if missing.",
)
@click.option(
    "--columns",
    type=click.Path(path_type=Path),
    help="YAML: how the files name each channel of the rig, and in which unit.",
)
@click.option(
    "--no-discovered",
    is_flag=True,
    help="Leave out of model.yaml what no effect of the catalogue explains; it is reported still.",
)
@click.option(
    "--accept-leaks",
    is_flag=True,
    help="Let model.yaml have what is suspected to be a leak; the detector will not see it then.",
)
@click.option("--json", "as_json", is_flag=True, help="One object instead of a table.")
def command(**options: Any) -> int:
    """Find where a model and recordings disagree, say what the model lacks, and add it.

    Recordings are .mcap, .csv, .csv.gz or .parquet, a row every 0.1 ms to 1 ms (1 s with --plant);
    gaps, uneven rows and empty cells are missing readings. The model is a shipped name or a file.
    Bulk modulus, discharge coefficient, viscous friction and supply pressure are refitted within
    their tolerances first. Then effects of the catalogue are tried, and what they do not explain is
    discovered: disturbances of an equation, a reading or a parameter as curves, with units, that
    predict what they were not fitted to. DIR/model.yaml is the model with both added, except what
    looks like a leak, or the given model where the additions would predict worse; DIR/report.html
    is one page with the whole story, DIR/gap.json holds all figures. What is being tried is told on
    stderr. Where the recordings do not show which of two effects is missing
    and some motion would, DIR/experiment.yaml is the campaign that settles the question.

    With --live --rig RIG no recordings are given: strokes, steps and slow reversals are run on the
    rig within its limits, 3 minutes in all, then an experiment for each open question; every
    revised model is tested on a run of its own, until it is adequate. --dry-run only shows the
    motions.

    Verdict: adequate, missing_effect, unknown_effect or inconclusive. The exit code is 0 for any
    verdict, and 2 if any input is bad: then every problem is on stderr, and nothing is written.
    With --live it is 3 if the rig tripped or was stopped.
    """
    # The search has a thread for each core already. If the library for matrices starts threads of
    # its own besides, they wait for one another, and a product may take twenty times the processor
    # time. The library reads this when numpy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # The search takes seconds to load, so neither --help nor a wrong option loads it.
    with first_compiling("search for effects", err=True):
        from .gap_finding import Asked, found_by

    return found_by(Asked(**options))
