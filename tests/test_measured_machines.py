"""The plants of docs/measured.md load, and take the recordings that the page tells of."""

from pathlib import Path

import pytest

from estimator.gap.plant import record_of
from estimator.gap.prediction.suitability import usable
from rig.configuration.models.plant_loading import load_plant

ROOT = Path(__file__).parents[1]
PLANTS = ROOT / "docs" / "measured"
RECORDINGS = ROOT.parent / "shared" / "data" / "measured"


@pytest.mark.parametrize(
    ("name", "recording", "seconds"),
    [("emps", "pulses", 24.8), ("press", "holdout", 23.6), ("seal", "o_ring_1bar", 73.5)],
)
def test_a_plant_of_a_measured_machine_loads_and_takes_its_recordings(
    name: str, recording: str, seconds: float
) -> None:
    own = load_plant(f"{PLANTS / name}.py:{name}", str(PLANTS / f"{name}.yaml"))
    assert own.plant.name == name
    file = RECORDINGS / name / f"{recording}.csv.gz"
    if not file.exists():
        pytest.skip("the recordings are not beside this checkout")
    records = usable([record_of(own.read(str(file)), own.plant)], own.plant)
    assert sum(map(len, records)) * own.plant.period == pytest.approx(seconds, rel=0.05)
