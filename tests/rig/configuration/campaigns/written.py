"""Writes campaign files for tests, and reads them back."""

from pathlib import Path

import pytest

from faults.campaign import Campaign, CampaignTest
from rig.configuration import ConfigError
from rig.configuration.campaigns.campaign import load_campaign

HEAD = "name: c\nrig: simulated\n"
SINE = "{type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}"
TEST = f"""\
tests:
  - name: a
    duration: 40 s
    setpoint: {SINE}
"""


def load(folder: Path, text: str) -> Campaign:
    path = folder / "campaign.yaml"
    path.write_text(text)
    return load_campaign(path)[0]


def only_test(folder: Path, keys: str = "", setpoint: str = SINE) -> CampaignTest:
    text = HEAD + TEST.replace(SINE, setpoint)
    (test,) = load(folder, text + "".join(f"    {line}\n" for line in keys.splitlines())).tests
    return test


def problems_of(folder: Path, keys: str = "", setpoint: str = SINE) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        only_test(folder, keys, setpoint)
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]


def fault(keys: str) -> str:
    return f"faults:\n  - {{{keys}}}\n"
