"""Checks that no folder holds too many modules and that no module is too long.

Run as `python -m tools.rooms`; `make check` runs it too. In a folder with too many modules, nobody
finds the right one; a module that is too long has more than one reason to change.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
PLACES: Final = ("rig", "estimator", "control", "faults", "tools", "tests")
MOST_MODULES: Final = 18
"""A folder may hold this many modules; its `__init__.py` is not counted."""
MOST_LINES: Final = 500


def problems() -> Iterator[str]:
    """Yield one message for each folder or file that is too big.

    Too big is a folder of `PLACES` with more than `MOST_MODULES` modules, or a module with more
    than `MOST_LINES` lines.
    """
    for package in PLACES:
        for folder in [ROOT / package, *sorted((ROOT / package).rglob("*/"))]:
            modules = [file for file in folder.glob("*.py") if file.name != "__init__.py"]
            name = folder.relative_to(ROOT)
            if len(modules) > MOST_MODULES:
                yield f"{name}: {len(modules)} modules, at most {MOST_MODULES}; give it rooms"
            for file in sorted(modules):
                lines = len(file.read_text().splitlines())
                if lines > MOST_LINES:
                    where = file.relative_to(ROOT)
                    yield f"{where}: {lines} lines, at most {MOST_LINES}; divide it"


def main() -> int:
    """Print the messages of `problems`; return 1 if there are any, otherwise 0."""
    found = list(problems())
    print(*found, sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
