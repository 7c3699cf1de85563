"""What a sweep's file may say of adaptive drawing, and what it is refused for."""

from pathlib import Path

import pytest

from rig.configuration.reading.problems import ConfigError
from rig.configuration.sweeps.sweep import load_sweep, sweep_lines
from rig.configuration.sweeps.sweep_plan import AdaptiveSizes, Sweep

TEXT = """\
name: near
rig: ideal
filter: product
cases: 960
leaks:
  flow: {log_uniform: [0.01 L/min, 1 L/min]}
  onset: 15 s
  adaptive: {}
motions:
  - {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
"""


def load(folder: Path, text: str) -> Sweep:
    (folder / "near.yaml").write_text(text)
    return load_sweep(folder / "near.yaml")


def test_keys_have_usual_values_and_a_plain_sweep_means_what_it_did(tmp_path: Path) -> None:
    assert load(tmp_path, TEXT).adaptive == AdaptiveSizes(0.95, 0.0, 96)
    given = load(tmp_path, TEXT.replace("{}", "{found: 80 %, interval: 10 %, batch: 48}"))
    assert given.adaptive == AdaptiveSizes(0.8, 0.1, 48)
    assert "adaptive" in given.meaning["leaks"]
    assert "adaptive" not in load(tmp_path, TEXT.replace("  adaptive: {}\n", "")).meaning["leaks"]


def test_a_check_tells_what_would_be_drawn(tmp_path: Path) -> None:
    sweep = load(tmp_path, TEXT.replace("{}", "{interval: 10 %, batch: 32}"))
    told = "\n".join(sweep_lines(sweep))
    assert "at most 960 cases" in told
    assert "adaptive: the first 32 cases have leaks from 0.01 L/min to 1 L/min" in told
    assert "at most 10 % above the lower end" in told
    assert "warning: a batch has 8 leaks of each place" in told


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("{}", "{batch: 100}", "is no multiple of 8"),
        ("{}", "{batch: 960}", "leaves none of the 960 cases"),
        ("{}", "{found: 99.9 %}", "is above 99 %"),
        ("{}", "{share: 90 %}", "is `found`"),
        ("{log_uniform: [0.01 L/min, 1 L/min]}", "0.1 L/min", "needs a range of flows"),
        ("{log_uniform: [0.01 L/min, 1 L/min]}", "{choice: [0.1 L/min, 1 L/min]}", "a range of"),
        ("flow: {log_uniform: [0.01 L/min, 1 L/min]}", "coefficient: 1e-9 m^3/(s Pa^0.5)",
         "needs leaks with one flow"),
        ("onset: 15 s", "onset: 15 s\n  healthy: 100 %", "all cases are healthy"),
        ("flow: {log_uniform: [0.01 L/min, 1 L/min]}\n  onset: 15 s",
         "profile: [{at: 15 s, flow: 0.1 L/min}]", "needs leaks with one flow"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_adaptively_is_refused(
    tmp_path: Path, before: str, after: str, said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        load(tmp_path, TEXT.replace(before, after))
