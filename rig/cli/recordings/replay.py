"""`rig replay`: runs filter and detector over recordings, as they would have run in the loop."""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import click

from estimator.filters import DEFAULT_FILTER, filter_named
from estimator.leaks import Baseline, load_baseline, replay
from rig.cli.problems import Problems
from rig.cli.ranges import Range
from rig.cli.screen import Screen
from rig.configuration import load_model
from rig.plant import Model
from rig.recording import Recording, read_recording
from rig.runner.outcomes import detector_of, sensors_of
from rig.runner.run_folder import findings, leak_figures

from .replay_table import Replayed, replay_table


@click.command()
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--filter",
    "filter_name",
    default=DEFAULT_FILTER,
    metavar="NAME",
    show_default=True,
    help="product, thesis-6 or thesis-7.",
)
@click.option(
    "--false-alarms-per-day",
    type=Range(1e-3, 1e3),
    default=1.0,
    show_default=True,
    help="What the verdicts of a healthy rig may cost.",
)
@click.option(
    "--baseline",
    "baseline_file",
    type=click.Path(path_type=Path),
    help="What is known of this healthy rig (rig baseline).",
)
@click.option("--json", "as_json", is_flag=True, help="One object a line instead of a table.")
def command(
    recordings: tuple[str, ...],
    model: str,
    filter_name: str,
    false_alarms_per_day: float,
    baseline_file: Path | None,
    as_json: bool,
) -> int:
    """Run filter and detector over recordings (.mcap, .csv, .csv.gz, .parquet).

    The model is a shipped name or a file. Exit code 0 whatever the verdicts, 2 if any input is bad:
    then every problem of every file is on stderr, and nothing on stdout.
    """
    problems = Problems()
    baseline = None
    with problems.collected():
        assumed = load_model(model)
        baseline = None if baseline_file is None else load_baseline(baseline_file, assumed.name)
    try:
        filter_named(filter_name)
    except ValueError as error:
        problems.add(f"--filter: {error}")
    replayed = []
    for recording in recordings:
        with problems.collected():
            content = read_recording(recording)
            # With bad input nothing else is told: the rest is read for its own problems only.
            if not problems.found:
                replayed.append(
                    _replay(
                        recording, content, assumed, filter_name, false_alarms_per_day, baseline
                    )
                )
    if problems.found:
        return problems.report()
    if as_json:
        for each in replayed:
            click.echo(json.dumps(json_object(each), allow_nan=False))
    else:
        screen = Screen()
        screen.print(replay_table(replayed, plain=not screen.is_terminal))
    return 0


def _replay(
    name: str,
    recording: Recording,
    model: Model,
    filter_name: str,
    false_alarms_per_day: float,
    baseline: Baseline | None,
) -> Replayed:
    if baseline is None:
        detector = detector_of(recording, model, filter_name, false_alarms_per_day)
    else:
        detector = baseline.detector(filter_name, model, false_alarms_per_day)
    result = replay(
        recording,
        model,
        filter_name=filter_name,
        false_alarms_per_day=false_alarms_per_day,
        detector=detector,
        sensors=sensors_of(recording),
    )
    resets = tuple(result.run.reset_times_s.tolist())
    detected_at_s = result.detected_at_s
    return Replayed(name, filter_name, result.decision, detected_at_s, resets, result.found)


def json_object(replayed: Replayed) -> dict[str, Any]:
    """Return a line of `--json`; other programs rely on its keys."""
    decision = replayed.decision
    figures = {
        "recording": replayed.recording,
        "verdict": str(decision.verdict),
        "onset_s": decision.onset_s,
        "detected_at_s": replayed.detected_at_s,
        "ended_s": decision.ended_s,
        **leak_figures(decision),
        "statistic": decision.statistic,
        "threshold": decision.threshold,
        "probabilities": dict(decision.probabilities) or None,
        "findings": findings(replayed.found),
        "filter": replayed.filter,
        "filter_resets_s": list(replayed.filter_resets_s),
    }
    # JSON has no infinity and no NaN.
    return {
        key: None if isinstance(value, float) and not isfinite(value) else value
        for key, value in figures.items()
    }
