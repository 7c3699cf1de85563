"""What an experiment leaves on the disk that was refused before it recorded anything."""

from pathlib import Path

import pytest

from rig.cli.models.experiments import experiment
from rig.configuration import load_rig


@pytest.mark.parametrize("existed", [False, True])
@pytest.mark.parametrize("recorded", [False, True])
def test_a_folder_that_was_made_for_nothing_is_removed(
    tmp_path: Path, existed: bool, recorded: bool
) -> None:
    folder = tmp_path / "tune"
    if existed:
        folder.mkdir()
    watched = experiment(load_rig("simulated"), None, folder, "off", "tuning", as_json=True)

    def refused() -> None:
        with watched:
            assert folder.is_dir()
            if recorded:
                (folder / "run.mcap").touch()
            raise LookupError("in use")

    with pytest.raises(LookupError, match="in use"):
        refused()
    assert folder.exists() == (existed or recorded)
