"""Configurations are found by name from anywhere, edited copies before shipped ones."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.models.model import load_model
from rig.configuration.reading.lookup import FOLDERS, available, copy_shipped, shipped_config_dir


def test_a_shipped_model_is_found_by_name_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_model("nominal").name == "nominal"


def test_an_edited_copy_wins_over_the_shipped_file(tmp_path: Path) -> None:
    copy_shipped(tmp_path / "mine")
    rig = tmp_path / "mine" / "rigs" / "simulated.yaml"
    rig.write_text(rig.read_text().replace("name: simulated", "name: edited"))
    _, used = load_campaign(tmp_path / "mine" / "campaigns" / "quickstart.yaml")
    assert used.name == "edited"
    _, used = load_campaign("quickstart", base=tmp_path / "mine")
    assert used.name == "edited"
    _, used = load_campaign("quickstart", base=tmp_path)
    assert used.name == "simulated"


def test_a_copy_of_the_shipped_files_is_complete_and_loads(tmp_path: Path) -> None:
    files = copy_shipped(tmp_path)
    shipped = shipped_config_dir()
    assert {file.relative_to(tmp_path) for file in files} == {
        file.relative_to(shipped) for file in shipped.rglob("*") if file.is_file()
    }
    campaign, _ = load_campaign("quickstart", base=tmp_path)
    assert all(Path(path).is_relative_to(tmp_path) for path in campaign.source_files)


def test_a_folder_that_holds_something_is_not_copied_into(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match="is not empty; give a new or empty folder"):
        copy_shipped(tmp_path)
    with pytest.raises(ConfigError):
        copy_shipped(tmp_path / "notes.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_rig_and_a_model_may_share_a_name() -> None:
    campaign, rig = load_campaign("simulation_7_1")
    assert (campaign.model.name, rig.plant.name) == ("thesis", "thesis")


@pytest.mark.parametrize("reference", ["nominl", "models/nominl.yaml"])
def test_a_missing_model_names_the_nearest_and_all_there_are(
    reference: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_model(reference, base=tmp_path)
    (problem,) = caught.value.problems
    assert "did you mean nominal?" in problem.remedy
    assert all(name in problem.remedy for name in available("model"))


def test_a_folder_is_not_a_configuration(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").mkdir()
    with pytest.raises(ConfigError, match="is not a file"):
        load_model("a.yaml", base=tmp_path)


def test_every_kind_is_shipped() -> None:
    assert all(available(kind) for kind in FOLDERS)
