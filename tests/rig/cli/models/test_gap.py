"""`rig gap` names what a model lacks, writes all of its files or none, and refuses bad input."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.gap.prediction.results import (
    ChannelGap,
    Curve,
    Discovered,
    Estimate,
    GapResult,
    NamedEffect,
    Rival,
)
from estimator.gap.verdict.describing import Wanted
from rig.cli.models import gap_finding
from rig.configuration.models.model import load_model
from rig.plant import NOMINAL, Parameters
from rig.plant.added_terms import AddedTerm, fields_of, terms_of
from rig.plant.integrator import TICK
from rig.recording import Recording, export
from rig.report.gap.words import headline
from tools.simulated.recordings import recorded_healthy

Invoke = Callable[..., Any]
FILES = {"model.yaml", "report.html", "gap.json"}
BIAS = 9e-6
CHANNELS = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")


@cache
def motion(rate: float, seconds: float, bias: float = BIAS) -> Recording:
    """A sum of two sines on a rig whose spool is off its null."""
    time_s = TICK * np.arange(round(seconds / TICK))
    setpoint = 0.3 + 0.04 * np.sin(rate * time_s) + 0.01 * np.sin(4.3 * rate * time_s)
    rig: Parameters = NOMINAL._replace(spool_null_bias=bias)
    whole = recorded_healthy(rig, setpoint, False, 1)
    return Recording({name: whole[name] for name in CHANNELS})


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with one recording to fit to and one to hold out."""
    export(motion(4.0, 5.0), tmp_path / "fit.csv")
    export(motion(5.0, 3.0), tmp_path / "held.csv")
    return tmp_path


def found() -> GapResult:
    """What the workflow might find, every part of it."""
    estimate = Estimate("value", "spool_null_bias", BIAS, 8.9e-6, 9.1e-6, "m", 0.0)
    rival = Rival("valve_hysteresis", 0.6, 12.0, 0.7)
    twin = Rival("constant_force", 0.995, 1.0, 0.99, "the same force while moving")
    effect = NamedEffect(
        "spool_null_bias", "y = x_sp + b_sp", "flows of both chambers", (estimate,),
        9e5, 100.0, 50.0, (twin,), (rival,), held_out_z=30.0,
    )  # fmt: skip
    at = np.linspace(-1e-4, 1e-4, 5)
    curve = Curve(
        "flow, chamber 1", "spool opening", at, 0.1 * at, 0.01 * np.abs(at), "m^3/s", "m",
        ("L/min", 6e4), ("um", 1e6), 1e5, 0.9,
    )  # fmt: skip
    channel = ChannelGap("position_m", 500.0, 1.2, 1.1, 1e-3, 1e-5, "m", ("um", 1e6), 0.9, 0.1, 0.1)
    result = GapResult("missing_effect", ["because"], [effect])
    result.refitted = [Estimate("viscous", "viscous", 352.0, 345.0, 359.0, "N s/m", 350.0)]
    result.channels, result.gap_before, result.gap_after = [channel], 499.0, 0.1
    result.where = result.rest = [curve]
    result.values = {**NOMINAL._asdict(), "spool_null_bias": BIAS}
    result.names = ("spool_null_bias",)
    result.identification, result.holdout = [("fit.csv", "a" * 64)], [("held.csv", "b" * 64)]
    return result


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the search give its answer at once."""
    monkeypatch.setattr(gap_finding, "find_gap", lambda *_, **__: found())


def test_what_a_rig_hides_is_named_and_written_into_a_model(invoke: Invoke, files: Path) -> None:
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out", "--json")
    assert done.code == 0
    reported = json.loads(done.out.splitlines()[-1])
    assert reported["verdict"] == "missing_effect"
    names = [entry["name"] for entry in reported["effects"]]
    assert names == ["spool_null_bias"]
    value = reported["effects"][0]["parameters"]["value"]
    assert value["lower"] <= BIAS <= value["upper"]
    assert value["value"] == pytest.approx(BIAS, rel=0.02)
    assert reported["gap"]["after"] < 0.2 * reported["gap"]["before"]
    model = load_model(files / "out" / "model.yaml")
    assert model.parameters.spool_null_bias == pytest.approx(BIAS, rel=0.02)
    assert model.provenance["parent"]["name"] == "nominal"


@pytest.mark.usefixtures("quick")
def test_the_json_object_has_the_promised_keys(invoke: Invoke, files: Path) -> None:
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out", "--json")
    reported = json.loads(done.out.splitlines()[-1])
    assert set(reported) >= {"verdict", "effects", "refitted", "gap", "where", "experiment"}
    (effect,) = reported["effects"]
    assert set(effect) == {
        "name", "parameters", "evidence", "indistinguishable_from", "form", "correction",
    }  # fmt: skip
    assert (effect["form"], effect["correction"]) == ("catalogue", None)
    assert reported["discovered"] == []
    assert set(effect["parameters"]["value"]) >= {"value", "lower", "upper", "unit"}
    assert effect["indistinguishable_from"] == ["constant_force"]
    assert reported["gap"] == {"before": 499.0, "after": 0.1, "scatter": 0.0}
    assert reported["refitted"]["viscous"]["value"] == 352.0
    assert reported["experiment"] is None
    assert reported["written"] == "with effects"
    assert reported["refitted"]["viscous"]["kept"] is True
    assert {path.name for path in (files / "out").iterdir()} == FILES
    figures = json.loads((files / "out" / "gap.json").read_text())
    assert figures["effects"][0]["rivals"][1]["name"] == "valve_hysteresis"


def drag(*, leak: bool = False, in_model: bool = True) -> Discovered:
    """Return a drag with the square of the velocity as it might be discovered, or a leak."""
    at = np.linspace(-0.1, 0.1, 5)
    curve = Curve(
        "force balance", "velocity", at, 9e3 * at * np.abs(at), 1.0 + 0.0 * at, "N", "m/s",
        ("N", 1.0), ("mm/s", 1e3), 4e4, 0.94,
    )  # fmt: skip
    return Discovered(
        "power_of_velocity", "force balance", "velocity", "", "x |x|",
        "A force that goes with the square of the velocity: 90.0 ± 2.0 N at 100 mm/s",
        "drag of oil in a line or port, or a damper",
        (Estimate("size", "", 9e3, 8.8e3, 9.2e3, "N/(m/s)^2", 0.0),),
        np.empty(0), np.empty(0), np.empty(0), "N", "m/s", 4e4, 31.0, 0.94, (499.0, 2.5),
        ("trend in force balance of time",), leak, in_model, "strokes at three speeds", curve,
    )  # fmt: skip


def discovering(each: Discovered) -> GapResult:
    """Return a result in which a disturbance was discovered, and no effect of the catalogue."""
    unknown = found()
    unknown.verdict, unknown.effects, unknown.names = "unknown_effect", [], ()
    unknown.discovered, unknown.accounted = [each], 0.94
    if each.in_model:
        unknown.values |= fields_of((AddedTerm("force balance", "velocity", "x |x|", False, 9e3),))
    return unknown


def test_what_is_discovered_is_in_the_one_model_and_in_every_report(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, files: Path
) -> None:
    (files / "out").mkdir()
    (files / "out" / "model_with_term.yaml").write_text("of an earlier version")
    monkeypatch.setattr(gap_finding, "find_gap", lambda *_, **__: discovering(drag()))
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out", "--json")
    reported = json.loads(done.out.splitlines()[-1])
    (each,) = reported["discovered"]
    assert set(each) == {
        "name", "equation", "of", "form", "text", "parameters", "evidence", "gap",
        "could_also_be", "in_model", "suspected_leak", "experiment",
    }  # fmt: skip
    assert (each["name"], each["equation"], each["of"]) == (
        "power_of_velocity", "force balance", "velocity",
    )  # fmt: skip
    assert each["gap"] == {"before": 499.0, "after": 2.5}
    assert each["parameters"]["size"] == {
        "value": 9e3, "lower": 8.8e3, "upper": 9.2e3, "unit": "N/(m/s)^2",
    }  # fmt: skip
    assert reported["accounted"] == 0.94
    assert reported["written"] == "with discovered"
    model = load_model(files / "out" / "model.yaml")
    assert terms_of(model.parameters) == (
        AddedTerm("force balance", "velocity", "x |x|", False, 9e3),
    )
    assert model.provenance["discovered"][0]["text"] == drag().text
    assert {path.name for path in (files / "out").iterdir()} == FILES
    page = (files / "out" / "report.html").read_text()
    for words in (drag().text, "nothing known the rest", "trend in force balance", "three speeds"):
        assert words in page


def test_the_terminal_shows_what_is_discovered_and_what_is_left(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, files: Path
) -> None:
    monkeypatch.setattr(gap_finding, "find_gap", lambda *_, **__: discovering(drag()))
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out")
    words = " ".join(done.out.split())
    assert "does not have: a force that goes with the square of the velocity" in words
    assert "This explains 94 % of the excess, nothing known the rest." in words
    assert "What is left: 0.100 noise variances above the floor, as rms position 10.0 um" in words
    assert "power of velocity in force balance of velocity" in words


def test_a_suspected_leak_is_told_and_not_in_the_model(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, files: Path
) -> None:
    left_out = discovering(drag(leak=True, in_model=False))
    monkeypatch.setattr(gap_finding, "find_gap", lambda *_, **__: left_out)
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out")
    assert "suspected leak, left out" in " ".join(done.out.split())
    assert terms_of(load_model(files / "out" / "model.yaml").parameters) == ()
    page = (files / "out" / "report.html").read_text()
    assert "so that the leak detector sees it" in page


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ((), Wanted(discovered=True, leaks=False)),
        (("--no-discovered",), Wanted(discovered=False, leaks=False)),
        (("--accept-leaks",), Wanted(discovered=True, leaks=True)),
    ],
)
def test_the_user_says_what_the_model_may_hold(
    monkeypatch: pytest.MonkeyPatch,
    invoke: Invoke,
    files: Path,
    options: tuple[str, ...],
    wanted: Wanted,
) -> None:
    asked: list[Wanted] = []

    def noted(*_: Any, wanted: Wanted, **__: Any) -> GapResult:
        asked.append(wanted)
        return found()

    monkeypatch.setattr(gap_finding, "find_gap", noted)
    assert invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out", *options).code == 0
    assert asked == [wanted]


def test_what_is_being_tried_is_told_on_stderr_alone(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, files: Path
) -> None:
    def says(*_: Any, said: Callable[[str], None], **__: Any) -> GapResult:
        said("trying the effects of the catalogue")
        return found()

    monkeypatch.setattr(gap_finding, "find_gap", says)
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out", "--json")
    assert "trying the effects of the catalogue" in done.err
    assert json.loads(done.out)["verdict"] == "missing_effect"


@pytest.mark.usefixtures("quick")
def test_model_says_where_it_comes_from(invoke: Invoke, files: Path) -> None:
    assert invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out").code == 0
    reported = load_model(files / "out" / "model.yaml").provenance
    assert reported["recordings"] == [{"source": "fit.csv", "sha256": "a" * 64}]
    assert reported["holdout"] == [{"source": "held.csv", "sha256": "b" * 64}]
    assert reported["effects"]["spool_null_bias"]["parameters"]["value"]["upper"] == 9.1e-6
    assert reported["gap"] == {"before": 499.0, "after": 0.1, "scatter": 0.0}


@pytest.mark.usefixtures("quick")
def test_terminal_and_page_state_the_finding_in_words(invoke: Invoke, files: Path) -> None:
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out")
    assert "The model lacks spool null bias, 9.00 ± 0.10 um (or constant force: " in done.out
    page = (files / "out" / "report.html").read_text()
    for words in ("spool null bias", "the same force while moving", "valve hysteresis", "held.csv"):
        assert words in page


def test_a_model_left_as_given_is_so_named_in_every_file(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, files: Path
) -> None:
    left = found()
    left.verdict, left.effects, left.names, left.as_given = "unknown_effect", [], (), True
    left.values, left.gap_after = dict(NOMINAL._asdict()), left.gap_before
    left.refitted = [replace(left.refitted[0], at_an_end=True)]
    left.reasons = ["with its refit it would predict worse; the model is written as given"]
    monkeypatch.setattr(gap_finding, "find_gap", lambda *_, **__: left)
    done = invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out")
    assert "the model is written as given" in done.out
    assert "refitted, not kept" in " ".join(done.out.split())
    assert "499 noise variances; the model is written as given" in " ".join(done.out.split())
    figures = json.loads((files / "out" / "gap.json").read_text())
    assert figures["written"] == "as given"
    assert figures["gap"] == {"before": 499.0, "after": 499.0, "scatter": 0.0}
    assert figures["refitted"]["viscous"]["kept"] is False
    assert figures["refitted"]["viscous"]["at_an_end"] is True
    model = load_model(files / "out" / "model.yaml")
    assert model.parameters == NOMINAL
    # What was not changed is not called revised.
    assert model.name == "nominal"
    assert model.provenance["written"] == "as given"
    assert model.provenance["refitted"]["viscous"]["kept"] is False
    page = (files / "out" / "report.html").read_text()
    assert "<dt>Model written</dt><dd>as given</dd>" in page
    assert "the end of its tolerance" in page
    assert "it is the model as given" in page


def test_a_rig_that_was_not_moved_is_inconclusive(invoke: Invoke, files: Path) -> None:
    still = {name: values[:1] + 0.0 * values for name, values in motion(4.0, 5.0).channels.items()}
    still["time_s"] = motion(4.0, 5.0)["time_s"]
    export(Recording(still), files / "still.csv")
    done = invoke("gap", "still.csv", "--holdout", "held.csv", "--out", "out", "--json")
    assert done.code == 0
    reported = json.loads(done.out.splitlines()[-1])
    assert reported["verdict"] == "inconclusive"
    assert any("never changes" in reason for reason in reported["reasons"])
    assert reported["effects"] == []
    assert {path.name for path in (files / "out").iterdir()} == FILES
    assert load_model(files / "out" / "model.yaml").parameters == NOMINAL


def test_what_is_fitted_to_cannot_be_held_out(invoke: Invoke, files: Path) -> None:
    done = invoke("gap", "fit.csv", "held.csv", "--holdout", "held.csv", "--out", "out")
    assert done.code == 2
    assert "held.csv holds the same samples as held.csv, which is fitted to" in done.err
    assert not (files / "out").exists()


def test_a_holdout_is_required(invoke: Invoke, files: Path) -> None:
    done = invoke("gap", "fit.csv", "--out", "out")
    assert done.code == 2
    assert "--holdout" in done.err
    assert not (files / "out").exists()


def test_every_problem_is_reported_at_once(invoke: Invoke, files: Path) -> None:
    (files / "out").write_text("")
    done = invoke("gap", "no.csv", "--holdout", "nor.csv", "--model", "none", "--out", "out")
    assert done.code == 2
    for words in ("no.csv", "nor.csv", "none", "out is a file"):
        assert words in done.err


@pytest.mark.usefixtures("quick")
def test_several_recordings_are_held_out_by_one_option(
    invoke: Invoke, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(motion(6.0, 3.0), files / "held_2.csv")
    given: list[int] = []

    def noted(fitted: list[Recording], held: list[Recording], *_: Any, **__: Any) -> GapResult:
        given.extend((len(fitted), len(held)))
        return found()

    monkeypatch.setattr(gap_finding, "find_gap", noted)
    invoke("gap", "fit.csv", "--holdout", "held.csv", "held_2.csv", "--out", "out")
    assert given == [1, 2]


@pytest.mark.usefixtures("quick")
def test_a_page_that_cannot_be_made_leaves_nothing_behind(
    invoke: Invoke, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("rig.runner.experiments.gap_results.dump_model", fails)
    assert invoke("gap", "fit.csv", "--holdout", "held.csv", "--out", "out").code == 1
    assert list((files / "out").iterdir()) == []


def test_the_headline_names_no_place_that_explains_next_to_nothing() -> None:
    unknown = found()
    unknown.verdict, unknown.effects, unknown.names = "unknown_effect", [], ()
    assert "flow, chamber 1 that goes with the spool opening" in headline(unknown)
    unknown.rest = [replace(unknown.rest[0], share=0.02)]
    assert "nor a steady disturbance" in headline(unknown)
