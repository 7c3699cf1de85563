"""`rig replay` runs filter and detector over recordings, as they would have run in the loop."""

import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final

import click
from rich.text import Text

from estimator.baselines import baseline_doubt, load_baseline
from estimator.filters import DEFAULT_FILTER, filter_named
from estimator.leaks import Decision, Found, detector_for, replay
from faults import Verdict, to_litres_per_minute
from rig.cli.application import Problems
from rig.cli.campaigns import leak
from rig.cli.option_types import Range
from rig.cli.screen import Screen
from rig.configuration import load_columns, load_model
from rig.plant import LEAKS
from rig.recording import Recording, read_measured
from rig.runner.outcomes import chance, detector_of, in_passing, onset_shown, percent, sensors_of
from rig.runner.run_folder import drift_of, findings, leak_figures, returns_of

_STYLES: Final[dict[str, str]] = {Verdict.HEALTHY: "green", Verdict.INCONCLUSIVE: "yellow"}


@dataclass(frozen=True)
class Replayed:
    """The results of filter and detector for one recording; `recording` is the path as given.

    `filter` is the name of the filter, `decision` the detector's last one, and `detected_at_s` the
    time in s at which the detector first named that decision's fault, None if it names none.
    """

    recording: str
    filter: str
    decision: Decision
    detected_at_s: float | None
    filter_resets_s: tuple[float, ...] = ()
    """Times in s at which the filter had diverged and was started anew."""
    found: tuple[Found, ...] = ()
    """All faults that the detector named, including those that ended again."""
    unfit: str = ""
    """Why the recording cannot be judged, in words; empty if it can."""
    notes: tuple[str, ...] = ()
    """What is unusual about how the recording was sampled, in words."""


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
@click.option(
    "--columns",
    "columns_file",
    type=click.Path(path_type=Path),
    help="YAML: how the files name each channel, and in which unit.",
)
@click.option("--json", "as_json", is_flag=True, help="One object a line instead of a table.")
def command(
    recordings: tuple[str, ...],
    model: str,
    filter_name: str,
    false_alarms_per_day: float,
    baseline_file: Path | None,
    columns_file: Path | None,
    as_json: bool,
) -> int:
    """Run filter and detector over recordings (.mcap, .csv, .csv.gz, .parquet).

    Rows may be 0.1 to 5 ms apart, uneven and with gaps; quicker ones are averaged to 1 kHz. What
    cannot show a leak, such as slower or interpolated rows, is inconclusive, with the reason.

    The model is a shipped name or a file. The exit code is 0 for any verdicts, and 2 if any input
    is bad: then every problem of every file is on stderr, and nothing on stdout.
    """
    problems = Problems()
    columns = None
    with problems.collected():
        columns = None if columns_file is None else load_columns(columns_file)
    with problems.collected():
        assumed = load_model(model)
        baseline = None if baseline_file is None else load_baseline(baseline_file, assumed)
    try:
        filter_named(filter_name)
    except ValueError as error:
        problems.add(f"--filter: {error}")

    def judged(name: str, recording: Recording) -> Replayed:
        rate = false_alarms_per_day
        if baseline is None:
            detector = detector_of(recording, assumed, filter_name, rate)
        else:
            detector = baseline.detector(filter_name, assumed, rate)
        detector = detector or detector_for(filter_name, assumed, rate)
        sensors = sensors_of(recording)
        result = replay(
            recording, assumed, filter_name=filter_name, detector=detector, sensors=sensors
        )
        resets = tuple(result.run.reset_times_s.tolist())
        notes = () if recording.sampling is None else tuple(recording.sampling.notes())
        verdict = (result.decision, result.detected_at_s, resets, result.found, result.unfit)
        return Replayed(name, filter_name, *verdict, notes)

    replayed = []
    for recording in recordings:
        with problems.collected():
            content = read_measured(recording, optional=("spool_m",), columns=columns)
            # Once any input is bad, the others are only read to report their problems too.
            if not problems.found:
                replayed.append(judged(recording, content))
    if problems.found:
        return problems.report()
    if baseline is not None and (doubt := baseline_doubt(str(baseline_file), baseline)):
        click.echo(f"warning: {doubt}", err=True)
    if as_json:
        for each in replayed:
            click.echo(json.dumps(json_object(each), allow_nan=False))
    else:
        right = ("onset", "detected", "leak flow", "statistic/threshold")
        headings = ("recording", "verdict", *right)
        Screen().print_table(headings, map(row_of, replayed), right=right, fold=headings)
    return 0


def json_object(replayed: Replayed) -> dict[str, Any]:
    """Return the object that `--json` prints for a recording; other programs rely on its keys.

    A number that is NaN or infinite becomes None.
    """
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
        **returns_of(decision),
        **drift_of(decision),
        "findings": findings(replayed.found),
        "reason": replayed.unfit or None,
        "sampling": list(replayed.notes),
        "filter": replayed.filter,
        "filter_resets_s": list(replayed.filter_resets_s),
    }
    # JSON cannot hold infinity or NaN.
    return {
        key: None if isinstance(value, float) and not isfinite(value) else value
        for key, value in figures.items()
    }


def row_of(each: Replayed) -> tuple[str | Text, ...]:
    """Return the cells of a recording's row: its path, verdict, times, leak flow and statistic."""
    decision = each.decision
    verdict = Text(decision.verdict, _STYLES.get(decision.verdict, "red"))
    if probable := chance(decision):
        verdict.append(f" {probable}", "default")
    if each.unfit:
        verdict.append(f": {each.unfit}", "default")
    elif decision.verdict == Verdict.INCONCLUSIVE:
        verdict.append(f": {advice(decision)}", "default")
    for line in in_passing(decision, each.found):
        verdict.append(f"; {line}", "yellow")
    if resets := each.filter_resets_s:
        times = f", {len(resets)} times" if len(resets) > 1 else ""
        verdict.append(f"; filter lost at {resets[0]:.2f} s{times}", "yellow")
    onset, detected = (
        "" if time_s is None else f"{time_s:.2f} s"
        for time_s in (onset_shown(decision), each.detected_at_s)
    )
    statistic = f"{decision.statistic:.1f}/{decision.threshold:.1f}"
    return each.recording, verdict, onset, detected, leak(decision), statistic


def advice(decision: Decision) -> str:
    """Return advice on an inconclusive decision, in words: what to record so that a leak shows."""
    if decision.could_also_be:
        return (
            "record for longer, with motion that reverses the pressure difference of the chambers"
        )
    if decision.suspected is not None:
        share = percent(decision.probabilities[decision.suspected])
        return (
            f"{decision.suspected} is likely ({share}), but not sure at the stated false-alarm "
            "rate; record for longer, or replay with a baseline of the healthy rig"
        )
    details = decision.details
    travel, needed = details.get("travel_m"), details.get("travel_needed_m")
    if travel is not None and needed is not None and travel < needed:
        return f"move the ram by more than {needed * 1e3:.0f} mm; it moved {travel * 1e3:.1f} mm"
    unseen = [(details.get(f"smallest_{name}_m3_per_s"), name) for name in LEAKS]
    flows = [(flow, name) for flow, name in unseen if flow is not None]
    if not flows:
        return "record for longer"
    flow, worst = max(flows, key=lambda each: each[0])
    return (
        f"{worst} up to {to_litres_per_minute(flow):.2g} L/min would not have shown; record for "
        "longer, with larger motion both ways"
    )
