"""Brings the tables of docs/tolerant_control.md up to date."""

import argparse
import re
from pathlib import Path
from typing import Final

from .comparison import comparison_table, comparisons, late, summary_table, tracking_table
from .margins import margins_table
from .proof import drawn, proof_table

PAGE: Final = Path(__file__).parents[2] / "docs" / "tolerant_control.md"
_TABLE: Final = re.compile(r"(<!-- table of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def with_tables(page: str, tables: dict[str, str]) -> str:
    """Return the text of `page` with the given tables put in, by name; other tables stay.

    A table for which the page has no place is left out.
    """

    def replaced(match: re.Match[str]) -> str:
        found = tables.get(match[2])
        return match[0] if found is None else f"{match[1]}{found}\n{match[3]}"

    return _TABLE.sub(replaced, page)


def main() -> None:
    """Run the studies that the command line asks for, and write their tables into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=200, help="rigs drawn for the proof")
    parser.add_argument("--told", action="store_true", help="tell the loop of the leak 3 s after "
                        "its onset, instead of asking the detector")  # fmt: skip
    parser.add_argument("--only", choices=("comparison", "proof", "margins"), help="of the tables")
    parser.add_argument("--tracking", action="store_true", help="run comparison and proof with the "
                        "tracking law, and write its tables")  # fmt: skip
    options = parser.parse_args()
    tables: dict[str, str] = {}
    if options.only in (None, "margins") and not options.tracking:
        tables["margins"] = margins_table()
    if options.only in (None, "comparison"):
        found = list(comparisons(options.told, options.tracking))
        if options.tracking:
            tables["tracking"] = f"{tracking_table(found)}\n\n{late(found)}"
        else:
            tables["summary"] = f"{summary_table(found)}\n\n{late(found)}"
            tables["comparison"] = comparison_table(found)
    if options.only in (None, "proof"):
        name = "tracking_proof" if options.tracking else "proof"
        trials = list(drawn(range(options.rigs), options.tracking))
        tables[name] = proof_table(trials, options.tracking)
    PAGE.write_text(with_tables(PAGE.read_text(), tables))


if __name__ == "__main__":
    main()
