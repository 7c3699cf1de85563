"""The gap of a model is closed on a rig that hides what the model lacks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.gap.plant.additions import Addition
from estimator.gap.plant.interface import Plant
from estimator.gap.prediction.results import (
    Check,
    Discovered,
    GapResult,
    NamedEffect,
    Rival,
    Separation,
)
from rig.configuration.campaigns.dry_run import plan_campaign
from rig.configuration.models.model import load_model
from rig.configuration.rigs.rig import Rig, load_rig
from rig.loop.interlocks.trip import TripError
from rig.plant import AddedTerm, Model
from rig.runner.campaign.campaign_run import bench_of
from rig.runner.campaign.simulated_bench import SimulatedBench
from rig.runner.campaign.stopping import StopFlag
from rig.runner.experiments import gap_closing, gap_motions
from rig.runner.experiments.gap_closing import Question, close_gap
from rig.runner.experiments.gap_motions import (
    CHECK,
    FITTED,
    HELD,
    campaign_of,
    motions_campaign,
    room_of,
    strokes,
)
from rig.runner.experiments.gap_results import gap_figures, rig_plant
from rig.runner.experiments.parts import ExperimentStoppedError, Parts
from rig.runner.experiments.worker_process import Said, T, Ts, Waits
from rig.runner.outcomes.observer import Observer

RIG = load_rig("simulated")
HIDDEN_S = 3e-3
AMONG = ("command_delay", "valve_bandwidth", "pressure_1_bias")
"""Names of the effects that are looked for where the whole catalogue would take too long."""
BRIEF: dict[str, Any] = {
    "FITTED": (("small fast strokes", 5.0),),
    "HELD": (("small steps", 4.0),),
    "CHECK": (("small steps", 5.0),),
    "EXPERIMENT_S": 5.0,
}
"""A programme of motions that takes less time than the one that is shipped."""


@pytest.fixture(scope="module", autouse=True)
def brief() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patched:
        for name, value in BRIEF.items():
            patched.setattr(gap_closing, name, value)
        patched.setattr(gap_motions, "EXPERIMENT_S", BRIEF["EXPERIMENT_S"])
        yield


def at_once(waits: Waits, said: Said, function: Callable[[Said, *Ts], T], *args: *Ts) -> T:
    """Compute in this process, as a worker."""
    waits()
    return function(said, *args)


def among_few(*given: Any) -> Plant:
    """Return the workflow's plant, of which only the effects `AMONG` are looked for."""
    plant = rig_plant(*given)
    return replace(plant, effects={name: plant.effects[name] for name in AMONG})


def hiding(truth: Model) -> Rig:
    return replace(RIG, plant=truth)


@pytest.fixture(scope="module")
def closed(brief: None, tmp_path_factory: pytest.TempPathFactory) -> GapResult:
    rig = hiding(Model().with_effect("command_delay", value=HIDDEN_S))
    folder = tmp_path_factory.mktemp("closed")
    # What the catalogue has is to be found here; what is discovered would only be a rival of it.
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            gap_closing, "rig_plant", lambda *given: replace(among_few(*given), layout=None)
        )
        return close_gap(rig, Model(), folder, worker=at_once)


def test_a_hidden_delay_is_named_and_its_gap_closed_without_help(closed: GapResult) -> None:
    assert closed.verdict == "missing_effect"
    (effect,) = closed.effects
    assert effect.name == "command_delay"
    assert not effect.indistinguishable
    assert effect.parameters[0].value == pytest.approx(HIDDEN_S, abs=1e-4)
    # How the ram sticks in five seconds decides what is left of the other channels.
    spool = next(gap for gap in closed.channels if gap.channel == "spool_m")
    assert spool.after - spool.floor < 0.1 * (spool.before - spool.floor)


def test_the_model_revised_is_adequate_on_a_run_of_its_own(closed: GapResult) -> None:
    last = closed.rounds[-1]
    assert last.check is not None
    assert last.check.verdict == "adequate"
    assert last.check.gap_after < last.check.gap_before


def test_no_recording_that_was_fitted_to_judges(closed: GapResult) -> None:
    fitted = {content for _, content in closed.identification}
    assert not fitted & {content for _, content in closed.holdout}
    assert all("check_" in source for source, _ in closed.holdout)


def test_the_figures_tell_the_rounds(closed: GapResult) -> None:
    rounds = gap_figures(closed, rig_plant(Model()))["rounds"]
    assert [each["round"] for each in rounds] == list(range(1, len(closed.rounds) + 1))
    assert rounds[-1]["check"]["verdict"] == "adequate"
    assert rounds[0]["motions"] == ["small fast strokes"]


def test_what_cannot_be_told_is_settled_by_its_experiment_before_any_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = campaign_of(strokes(room_of(RIG))["small steps"])
    either = Separation(("command_delay", "valve_bandwidth"), "small steps", steps, 0.9, 8.0)
    asked: list[list[str]] = []

    def answers(
        _: Said, question: Question, fitted: Sequence[Path], held: Sequence[Path]
    ) -> GapResult:
        asked.append([file.stem for file in fitted])
        rivals = (Rival("valve_bandwidth", 0.995, 2.0, 0.99),) if len(asked) == 1 else ()
        effect = NamedEffect("command_delay", "", "spool", (), 1e4, 25.0, 20.0, rivals)
        values = question.model.parameters._asdict()
        found = GapResult("missing_effect", [], [effect], values=values)
        found.experiments = [either] if rivals else []
        return found

    def checks(
        _: Said, question: Question, found: GapResult, fresh: Sequence[Path], held: Sequence[Path]
    ) -> tuple[Check, GapResult]:
        assert not set(fresh) & set(held)
        return Check("adequate", (), 100.0, 1.0), found

    monkeypatch.setattr(gap_closing, "answer_to", answers)
    monkeypatch.setattr(gap_closing, "checked", checks)
    found = close_gap(RIG, Model(), tmp_path, worker=at_once)
    assert asked == [["small_fast_strokes"], ["small_fast_strokes", "small_steps"]]
    first, second = found.rounds
    assert first.check is None
    assert second.why == "to tell command delay from valve bandwidth"
    assert second.check is not None


def test_a_revised_model_that_a_check_shows_to_be_worse_gives_way_to_the_one_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong_values = {"bulk_modulus": 4e8, "command_delay": 4e-3}
    values = {**rig_plant(Model()).nominal, **wrong_values}
    effect = NamedEffect("command_delay", "", "spool", (), 1e4, 25.0, 20.0)
    wrong = GapResult("missing_effect", [], [effect], values=values, names=("command_delay",))
    monkeypatch.setattr(gap_closing, "find_gap", lambda *_, **__: GapResult("missing_effect", []))
    rig = hiding(Model())
    campaign = motions_campaign("check", BRIEF["CHECK"], rig, Model(), 3)
    bench = bench_of(campaign, rig, tmp_path, Observer(), StopFlag())
    with bench:
        parts = Parts(rig, tmp_path, bench, "fast", Observer(), StopFlag())
        fresh = list(parts.record(campaign).values())
    check, left = gap_closing.checked(print, Question(rig, Model()), wrong, fresh, fresh)
    assert check.gap_after > check.gap_before
    assert left.as_given
    assert left.values == rig_plant(Model()).nominal
    assert left.gap_after == left.gap_before
    assert left.verdict == "unknown_effect"
    assert not left.effects
    assert (
        "with command_delay, on the check, the recordings held out would be predicted worse"
        in left.reasons[-1]
    )
    assert wrong.effects
    assert not wrong.reasons


def test_a_trip_while_the_model_is_fitted_does_not_lose_what_was_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trips(waits: Waits, said: Said, function: Callable[[Said, *Ts], T], *args: *Ts) -> T:
        monkeypatch.setattr(SimulatedBench, "idle", _trip)
        waits()
        return function(said, *args)

    def answers(
        _: Said, question: Question, fitted: Sequence[Path], held: Sequence[Path]
    ) -> GapResult:
        effect = NamedEffect("command_delay", "", "spool", (), 1e4, 25.0, 20.0)
        return GapResult("missing_effect", [], [effect])

    monkeypatch.setattr(gap_closing, "answer_to", answers)
    found = close_gap(RIG, Model(), tmp_path, worker=trips)
    assert found.effects
    assert len(found.rounds) == 1
    assert "missed ticks" in found.ended_by


def _trip(_: SimulatedBench) -> None:
    raise TripError("tripped: the loop missed ticks")


def test_a_model_that_lacks_nothing_is_left_after_one_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gap_closing, "rig_plant", among_few)
    monkeypatch.setattr(gap_closing, "FITTED", (("small steps", 5.0),))
    found = close_gap(hiding(Model()), Model(), tmp_path, worker=at_once)
    assert found.verdict == "adequate"
    assert not found.effects
    assert len(found.rounds) == 1


def test_a_stop_ends_it_with_what_was_recorded(tmp_path: Path) -> None:
    stop = StopFlag()
    stop.request("SIGINT")
    with pytest.raises(ExperimentStoppedError):
        close_gap(hiding(Model()), Model(), tmp_path, worker=at_once, stop=stop)


@pytest.mark.parametrize("wanted", [FITTED, HELD, CHECK])
def test_every_motion_keeps_to_the_rigs_limits(wanted: tuple[tuple[str, float], ...]) -> None:
    rig = load_rig("simulated")
    for planned in plan_campaign(motions_campaign("any", wanted, rig, Model(), 3), rig):
        low, high = planned.position_range_m
        assert rig.limits.position_min_m + 0.015 < low
        assert high < rig.limits.position_max_m - 0.015
        assert not planned.warnings


@pytest.mark.parametrize(
    ("check", "done"),
    [
        (Check("adequate", (), 5.0, 0.9), True),
        (Check("adequate", (), 5.0, 1.6), False),
        (Check("adequate", (), 5.0, 1.6, scatter=1.0), True),
        (Check("missing_effect", ("command_delay",), 5.0, 0.0), True),
        (Check("missing_effect", ("payload_mass",), 5.0, 0.0), False),
        (Check("unknown_effect", (), 5.0, 0.0), False),
    ],
    ids=["gone", "left", "left by chance", "the same", "another", "unknown"],
)
def test_a_round_is_the_last_where_the_check_leaves_nothing_but_chance(
    check: Check, done: bool
) -> None:
    effect = NamedEffect("command_delay", "", "spool", (), 1e4, 25.0, 20.0, ())
    found = GapResult("missing_effect", [], [effect])
    assert gap_closing._Closing.is_done(found, check) is done


def disturbance(place: str, *, in_model: bool) -> Discovered:
    none = np.empty(0)
    return Discovered(
        "threshold", place, "pressure 1", "", "hinge", "It begins", "a relief valve", (),
        none, none, none, "m^3/s", "Pa", 1e4, 20.0, 0.9, in_model=in_model,
    )  # fmt: skip


LEAK = "flow, chamber 1 of pressure 1"


@pytest.mark.parametrize(
    ("check", "in_model", "done"),
    [
        (Check("adequate", (), 5.0, 0.9), True, True),
        (Check("unknown_effect", (), 5.0, 4.0, 0.0, (LEAK,)), False, True),
        (Check("unknown_effect", (), 5.0, 4.0, 0.0, (LEAK,)), True, False),
        (Check("unknown_effect", (), 5.0, 0.1, 0.0, ("spool of time",)), False, False),
        (Check("missing_effect", ("payload_mass",), 5.0, 4.0, 0.0, (LEAK,)), False, False),
    ],
    ids=["gone", "left out on purpose", "not gone though added", "another", "an effect besides"],
)
def test_a_round_is_the_last_where_nothing_more_is_discovered(
    check: Check, in_model: bool, done: bool
) -> None:
    discovered = [disturbance("flow, chamber 1", in_model=in_model)]
    found = GapResult("unknown_effect", [], discovered=discovered)
    assert gap_closing._Closing.is_done(found, check) is done


def test_the_revised_model_has_what_was_discovered_in_the_rigs_equations_and_beside_them() -> None:
    layout = rig_plant(Model()).layout
    assert layout is not None
    wave = Addition("force balance", "position", "", "wave", (0.04, 0.3), (180.0,))
    drift = Addition("reading of pressure_1_Pa", "time", "", "x", (), (3e3,))
    plant = rig_plant(Model())
    values = {**plant.nominal, **layout.values([wave, drift])}
    found = GapResult("unknown_effect", [], values=values)
    revised = rig_plant(gap_closing.revised_model(Model(), found))
    assert layout.additions(revised.nominal) == [wave, drift]


def test_a_term_that_the_workflow_cannot_hold_stays_in_the_model(tmp_path: Path) -> None:
    terms = (
        AddedTerm("parameter viscous", "time", "x", turned=False, size=2.0),
        AddedTerm("bulk modulus", "time", "x", turned=False, size=-1e6),
    )
    given = Model(discovered=terms)
    plant = rig_plant(given)
    found = GapResult("adequate", [], values=dict(plant.nominal))
    assert gap_closing.revised_model(given, found).discovered == terms
    plant.write(plant.nominal, (), {}, tmp_path / "model.yaml")
    written = load_model(tmp_path / "model.yaml")
    assert (written.name, written.discovered) == (given.name, terms)
