"""What docs/thesis_tables.md says of the thesis's filters holds on the simulated rig."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.filters.thesis import THESIS6_MEASUREMENT_NOISE
from rig.configuration.campaigns.campaign import load_campaign
from rig.plant import NOMINAL
from tools.thesis_tables.__main__ import DEFAULT_OUT, main
from tools.thesis_tables.causes import VELOCITY, empty_chamber, hidden_leak, oil_column
from tools.thesis_tables.leak_tables import (
    LOCATIONS,
    columns_of,
    innovation_change,
    leak_table,
    outside_change,
    residual_change,
    state_change,
    trusted_change,
)
from tools.thesis_tables.markdown import arrow, figure, table
from tools.thesis_tables.measures import Change, metered_coefficient, rise, share_outside, true_flow
from tools.thesis_tables.printed import TABLE_5_1
from tools.thesis_tables.trials import Trial, Trials, record, run_trials
from tools.thesis_tables.trusted import run_trusted
from tools.thesis_tables.validation import FILES, compare, compare_without_drift

TEMPLATE = Path("tools/thesis_tables/page.md.j2")
ROOT = Path(__file__).parents[2]
CHAMBER_1, INTERNAL = "external_leakage_1", "internal_leakage"


@pytest.fixture(scope="module")
def open_loop() -> Trials:
    return run_trials("open_loop_5_1", "thesis-6", (CHAMBER_1, INTERNAL))


@pytest.fixture(scope="module")
def leaks(open_loop: Trials) -> list[Trial]:
    return open_loop.leaks(CHAMBER_1)


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.long
def test_the_table_sets_printed_figures_over_computed_ones(open_loop: Trials) -> None:
    lines = leak_table(columns_of(open_loop, TABLE_5_1, (CHAMBER_1, INTERNAL)), 6).splitlines()
    rows = [cells(line) for line in lines]
    assert rows[0] == [
        "",
        "healthy",
        "chamber 1, low",
        "chamber 1, high",
        "internal, low",
        "internal, high",
    ]
    assert {len(row) for row in rows} == {6}
    by_label = {row[0]: row[1:] for row in reversed(rows)}
    assert by_label["printed"] == ["0.10", "0.19", "0.34", "0.16", "0.22"]
    assert all("→" in cell for cell in by_label["innovation"][1:])
    assert "→" not in by_label["innovation"][0]
    assert by_label["product's detector at the end"][0] == "**healthy**"


@pytest.mark.long
def test_a_leak_in_chamber_1_raises_its_innovation_more_than_the_others(
    leaks: list[Trial],
) -> None:
    # The low leak: what a high one does to the printed filter depends on noise (see the page).
    assert rise(innovation_change(leaks[0], 0)) > 2.0 * rise(innovation_change(leaks[0], 1))
    for trial in leaks:
        assert rise(trusted_change(trial, 0)) > 2.0 * rise(trusted_change(trial, 1))


@pytest.mark.long
def test_with_the_encoder_trusted_the_average_grows_with_the_leak(leaks: list[Trial]) -> None:
    low, high = (rise(trusted_change(trial, 0)) for trial in leaks)
    assert 0.0 < low < high


@pytest.mark.long
def test_the_residual_of_the_thesis_is_far_below_its_printed_level(open_loop: Trials) -> None:
    healthy = open_loop.healthy()
    for chamber in range(2):
        residual = residual_change(healthy, chamber).before
        innovation = innovation_change(healthy, chamber).before
        assert residual is not None
        assert innovation is not None
        assert residual < 0.2 * innovation


@pytest.mark.long
def test_a_leak_carries_the_printed_filter_out_of_the_stroke_and_not_one_that_trusts_the_encoder(
    leaks: list[Trial],
) -> None:
    for trial in leaks:
        before, after = outside_change(trial)
        assert before is not None
        assert after is not None
        assert before < 1.0 < 5.0 < after
        assert share_outside(trial.trusted.states[:, 3], trial) == (0.0, 0.0)


@pytest.mark.long
def test_an_internal_leak_hides_in_the_estimated_velocity(open_loop: Trials) -> None:
    for trial in open_loop.leaks(INTERNAL):
        hidden = hidden_leak(trial, trial.thesis.run.states[:, VELOCITY])
        assert 0.5 < rise(hidden.error) / hidden.leak < 1.2


@pytest.mark.long
def test_the_meters_read_an_external_leak_within_their_fixed_error(leaks: list[Trial]) -> None:
    for trial in leaks:
        metered = metered_coefficient(trial)
        assert metered is not None
        assert trial.leak is not None
        assert metered.mean == pytest.approx(trial.leak.coefficient, rel=0.2)


@pytest.mark.long
def test_with_the_printed_variance_the_trusting_filter_is_the_thesiss(open_loop: Trials) -> None:
    trial = open_loop.healthy()
    printed = run_trusted(trial.recording, trial.model, "thesis-6", THESIS6_MEASUREMENT_NOISE[0])
    np.testing.assert_array_equal(printed.outputs[1:], trial.thesis.run.outputs[1:])


@pytest.mark.long
def test_the_same_seeds_give_the_same_table(open_loop: Trials) -> None:
    again = run_trials("open_loop_5_1", "thesis-6", (CHAMBER_1, INTERNAL))
    first, second = (
        leak_table(columns_of(trials, TABLE_5_1, (CHAMBER_1, INTERNAL)), 6)
        for trials in (open_loop, again)
    )
    assert first == second


def test_the_drift_of_a_rig_tells_its_spool_null_bias() -> None:
    campaign, rig = load_campaign("validation_3_2", "ideal")
    test = next(t for t in campaign.tests if t.name == "sine")
    biased = replace(rig, plant=rig.plant.with_effect("spool_null_bias", value=2e-6))
    recording = record(biased, test, campaign.model)
    found = compare_without_drift(recording, campaign.model)
    assert found.null_bias == pytest.approx(2e-6, abs=3e-7)
    drifting = compare(recording, campaign.model)
    assert np.abs(found.position).mean() < 0.1 * np.abs(drifting.position).mean()


def test_forward_euler_multiplies_the_oil_column_most_near_an_end() -> None:
    near, middle = oil_column(NOMINAL, 0.02), oil_column(NOMINAL, 0.3)
    assert near.growth > middle.growth > 1.0
    assert near.resonance > middle.resonance


def test_a_chamber_is_empty_beyond_its_end_of_the_stroke() -> None:
    first, second = empty_chamber(NOMINAL)
    assert first < NOMINAL.stroke_min
    assert second > NOMINAL.stroke_max


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (0.0951, "0.095"),
        (0.0996, "0.10"),
        (2.04, "2.0"),
        (-25.6, "-26"),
        (99.9, "100"),
        (203.7, "204"),
        (35609.0, "35600"),
        (1.351e6, "1.35e6"),
        (4.13e-9, "4.1e-9"),
        (float("nan"), "not finite"),
    ],
)
def test_figures_have_two_digits_and_large_ones_three(value: float | None, text: str) -> None:
    assert figure(value) == text


def test_a_change_is_written_with_an_arrow() -> None:
    assert arrow(Change(1.5e5, 2.9e5), 1e6) == "0.15 → 0.29"
    assert arrow(Change(None, 0.32), decimals=2) == "0.32"
    assert arrow(Change(None, None)) == "–"


def test_a_row_that_does_not_fit_its_table_is_refused() -> None:
    with pytest.raises(ValueError, match="row of 1 cells in a table of 2 columns"):
        table(["a", "b"], [["only"]])


def test_missing_recordings_are_all_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "page.md"
    assert main(["--measured", str(tmp_path), "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in FILES.values())
    assert not out.exists()


def test_the_committed_page_is_of_the_present_template() -> None:
    page = DEFAULT_OUT.read_text(encoding="utf-8")
    template = (ROOT / TEMPLATE).read_text(encoding="utf-8")
    optional = re.sub(r"{% if .*?{% endif %}", "{{ }}", template, flags=re.S)
    position = 0
    for literal in re.split(r"{{.*?}}", optional):
        found = page.find(literal.strip(), position)
        assert found >= 0, f"run python -m tools.thesis_tables: not in the page: {literal[:80]!r}"
        position = found + len(literal.strip())


def test_no_table_of_the_committed_page_is_wider_than_a_screen() -> None:
    width = 0
    for line in DEFAULT_OUT.read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            width = 0
            continue
        width = width or len(cells(line))
        assert len(cells(line)) == width <= 12


@pytest.mark.long
def test_the_products_filter_has_the_leak_in_the_state_of_its_place(leaks: list[Trial]) -> None:
    for trial in leaks:
        true = true_flow(trial)
        assert true is not None
        states = {kind: state_change(trial, kind) for kind in LOCATIONS}
        assert abs(states[CHAMBER_1].before or 0.0) < 0.1 * true
        assert states[CHAMBER_1].after == pytest.approx(true, rel=0.15)
        for kind in set(LOCATIONS) - {CHAMBER_1}:
            assert abs(states[kind].after or 0.0) < 0.15 * true
