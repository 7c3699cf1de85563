"""Stores the results of a run as the reference that `make gate` compares with.

What depends on the machine is left out. Run as `python -m tools.reference_run RUN FOLDER`.
"""

import json
import sys
from pathlib import Path

from rig.runner.run_folder.archive import read_run

_OF_A_MACHINE = ("source_files", "command", "git")


def main(run: Path, folder: Path) -> None:
    """Write a run's `results.json` to `folder`, without what depends on the machine.

    Three entries of the provenance are left out (source files, command, git), the wall time of
    every test is set to 0, and its friction to None. The folder is created if it is missing, and a
    `results.json` in it is replaced.
    """
    results = dict(read_run(run).results)
    entries = results["provenance"].items()
    results["provenance"] = {key: value for key, value in entries if key not in _OF_A_MACHINE}
    results["tests"] = [test | {"wall_s": 0.0, "friction": None} for test in results["tests"]]
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, ensure_ascii=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
