"""The examples of the documentation run as they stand."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rig.configuration import check
from rig.configuration.campaigns.schedule import load_schedule
from rig.configuration.reading.lookup import copy_shipped
from rig.io.simulated import simulated_rig
from rig.plant import Model
from rig.plant.simulation import simulate
from rig.recording import Recording, export

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
EXAMPLES = re.findall(
    r"## ([^\n]+)\n(?:(?!\n## ).)*?```python\n(.*?)```", (DOCS / "api.md").read_text(), re.DOTALL
)


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def leaking(workplace: Path) -> None:
    """Write the recording that examples read."""
    time = np.arange(30000) * 1e-3
    command = 3.0 * np.sin(np.pi * time + 0.1)
    faults = np.zeros((time.size, 8))
    faults[12000:, 0] = 4e-9
    truth = simulate(Model(), command, position=0.3, faults=faults)
    noise = simulated_rig(Model(), 1).noise(time.size)
    channels = {
        "time_s": time,
        "command_V": command,
        "position_m": np.round(truth["position"] / 3e-5) * 3e-5,
        "pressure_1_Pa": truth["pressure_1"] + 3e4 * noise[:, 1],
        "pressure_2_Pa": truth["pressure_2"] + 3e4 * noise[:, 2],
    }
    export(Recording(channels), workplace / "leaking.csv.gz")


def shorter_quickstart(workplace: Path) -> None:
    """Write a quickstart campaign of two tests, which is found there before the shipped one."""
    campaign = yaml.safe_load((ROOT / "config" / "campaigns" / "quickstart.yaml").read_text())
    leak = campaign["tests"][1]
    leak["matrix"] = {"leak": ["external_leakage_1"], "level": {"high": "0.8 L/min"}}
    (workplace / "campaigns").mkdir()
    shorter = campaign | {"tests": [campaign["tests"][0], leak]}
    (workplace / "campaigns" / "quickstart.yaml").write_text(yaml.safe_dump(shorter))


@pytest.mark.parametrize(("title", "code"), EXAMPLES, ids=[title for title, _ in EXAMPLES])
def test_the_example_runs(
    title: str, code: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "leaking.csv.gz" in code:
        leaking(workplace)
    if '"quickstart"' in code:
        shorter_quickstart(workplace)
    exec(compile(code, title, "exec"), {"__name__": "example"})
    assert capsys.readouterr().out.strip()


def test_the_campaign_of_the_campaigns_page_checks_without_a_warning(workplace: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", (DOCS / "campaigns.md").read_text(), re.DOTALL)
    (workplace / "example.yaml").write_text(example)
    report = check("example.yaml")
    assert len(report.tests) == 11
    assert not report.warnings


def test_the_files_of_the_operating_guide_check_among_the_copies_of_rig_init(
    workplace: Path,
) -> None:
    copy_shipped(Path("mine"))
    guide = (DOCS / "operating.md").read_text()
    for path in ("mine/campaigns/today.yaml", "mine/schedules/tonight.yaml"):
        assert path in guide
    campaign, schedule = re.findall(r"```yaml\n(.*?)```", guide, re.DOTALL)
    Path("mine/campaigns/today.yaml").write_text(campaign)
    Path("mine/schedules/tonight.yaml").write_text(schedule)
    report = check("mine/campaigns/today.yaml")
    assert [planned.test.name for planned in report.tests] == ["healthy", "leak across the piston"]
    assert not report.warnings
    (entry,) = load_schedule(Path("mine/schedules/tonight.yaml")).entries
    assert entry.name == "leaks"


def test_every_section_of_the_api_page_has_an_example() -> None:
    assert len(EXAMPLES) == (DOCS / "api.md").read_text().count("\n## ") == 4


def test_every_attack_that_is_told_of_has_its_test() -> None:
    table = (DOCS / "safety.md").read_text().partition("## Attacks")[2].partition("## Chaos")[0]
    named = set(re.findall(r"`(test_\w+)`", table))
    written = {
        name
        for file in Path(__file__).parent.rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)
    }
    assert len(named) > 40
    assert named - written == set()


@pytest.mark.parametrize(
    "page", [*ROOT.glob("*.md"), *DOCS.rglob("*.md")], ids=lambda page: page.name
)
def test_every_link_to_a_file_leads_to_one(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    linked = re.findall(r"\]\((?!https?:)([^)#\s]+)", text)
    assert [link for link in linked if not (page.parent / link).exists()] == []
