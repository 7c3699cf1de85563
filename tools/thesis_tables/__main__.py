"""Writes docs/thesis_tables.md: `python -m tools.thesis_tables [--measured DIR] [--out FILE]`."""

import argparse
import sys
from pathlib import Path

from rig.recording import RecordingError

from .page import page
from .validation import Measured, read_measured

DEFAULT_OUT = Path(__file__).parents[2] / "docs" / "thesis_tables.md"


def main(arguments: list[str] | None = None) -> int:
    """Write the page and return 0; if a recording cannot be read, write nothing and return 2.

    `arguments` are those of the command line; None means those of the program.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.thesis_tables", description=__doc__)
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="DIR",
        help="recordings to validate section 3.2 against too",
    )
    parser.add_argument(
        "--origin", default="not stated", help="what the recordings are, for the page to say"
    )
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    measured: Measured | None = None
    if options.measured is not None:
        try:
            measured = read_measured(options.measured, options.origin)
        except RecordingError as error:
            print(error, file=sys.stderr)
            return 2
    options.out.write_text(page(measured), encoding="utf-8")
    print(options.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
