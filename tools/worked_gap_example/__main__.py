"""Computes the worked example of docs/gap.md: how much a revised model improves the leak detector.

An effect is hidden in a rig that shares no code with the model (`tools.hidden_effects`). `rig gap`
gets two recordings of the rig and a held-out one, and writes a revised model. Then the same rig is
recorded many times, healthy or with a leak that opens, in motions drawn at random. The detector
judges every recording twice: with the nominal model and with the revised one.

    python -m tools.worked_gap_example               # the first case, 3 minutes of processor time
    python -m tools.worked_gap_example --all --page docs/gap.md --images docs/images

For effects that the detector should bear without any revision (`trials.PLAIN`), the revised model
is the true one instead, because no workflow can find a better one.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rig.plant import Model
from tools.pages.marked_tables import fill

from .pictures import accounts_picture, sizes_picture
from .tables import by_case, by_size
from .trials import (
    CASES,
    ONSET_S,
    PLAIN,
    SECONDS,
    hiding,
    leaking,
    recorded,
    recording_of,
    revised_model,
    tried,
    true_flow,
)

_SHOWN: Final = 0.06
"""Size of the leak in the picture of the oil accounts, L/min at its reference drop."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that the command line asks for, and print their tables.

    With `--page` the tables are written into that page, and with `--images` pictures are drawn.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tools.worked_gap_example",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, default=Path("runs/worked"), metavar="DIR")
    parser.add_argument("--all", action="store_true", help="every case, not the first alone")
    parser.add_argument("--seed", type=int, default=1, help="draws everything; default 1")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page whose tables to bring up")
    parser.add_argument("--images", type=Path, metavar="DIR", help="folder for the pictures")
    options = parser.parse_args(arguments)
    cases = (*CASES, *PLAIN) if options.all else CASES[:1]
    found = {case: tried(case, options.out, options.seed) for case in cases}
    first = cases[0]
    tables = {"worked_sizes": by_size(found[first])}
    if options.all:
        tables["worked_cases"] = by_case(found)
    if options.images:
        sizes_picture(found[first], options.images / "gap_detector_sizes.png")
        rig = hiding(first, options.seed)
        model = revised_model(first, rig, options.out, options.seed)
        values = leaking(rig, "external_leakage_1", _SHOWN)
        shown = recorded(values, "steps", [options.seed, 4], SECONDS)
        accounts_picture(
            recording_of(shown), {"nominal": Model(), "revised": model}, ONSET_S,
            true_flow(values, "external_leakage_1", shown),
            options.images / "gap_detector_accounts.png",
        )  # fmt: skip
    if options.page:
        fill(options.page, tables)
    print("\n\n".join(tables.values()))


if __name__ == "__main__":
    main()
