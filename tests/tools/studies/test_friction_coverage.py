"""The study of friction's intervals knows its motions by name."""

import numpy as np
import pytest

from tools.studies.friction_coverage import EXPERIMENT, main, setpoint_of


def test_a_motion_that_is_misspelt_is_refused_and_the_known_ones_are_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["friction_coverage", "--rigs", "0", "--motion", "experimant"])
    with pytest.raises(SystemExit):
        main()
    told = capsys.readouterr().err
    assert "experimant" in told
    assert EXPERIMENT in told


def test_only_its_own_name_stands_for_the_experiment() -> None:
    rng = np.random.default_rng(1)
    assert setpoint_of(EXPERIMENT, rng, 500).max() == pytest.approx(0.5, abs=0.01)
    with pytest.raises(KeyError):
        setpoint_of("experimant", rng, 500)
