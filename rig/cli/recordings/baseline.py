"""`rig baseline` learns from healthy recordings what the detector may assume of a rig."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from estimator.accounts import MOST_MODEL_ERROR
from estimator.baselines import (
    LEAST_LEARNING_S,
    Baseline,
    accepted_onto,
    baseline_doubt,
    learn_baseline,
    load_baseline,
    write_baseline,
)
from estimator.learnt import REGIMES, LearntNoise, expected_alarms, noise_content
from rig.cli.application import Problems
from rig.cli.screen import Screen
from rig.configuration import load_model
from rig.recording import Recording, read_recording


@click.command()
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="File to write.",
)
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--model-error",
    type=click.FloatRange(0.0, MOST_MODEL_ERROR),
    help="Factor on what the detector allows for errors of the model; 0: it is exact. With it, the "
    "rig's own noise is not learnt.  [default: 1 where it is not learnt]",
)
@click.option(
    "--onto",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Baseline to learn on from: the recordings are later ones of the same rig, and you accept "
    "them as healthy.",
)
def command(
    recordings: tuple[str, ...],
    out: Path,
    model: str,
    model_error: float | None,
    onto: Path | None,
) -> int:
    """Learn from healthy recordings of a rig what is normal for it, for `rig replay --baseline`.

    Recordings that do not look healthy are refused, and so are recordings that together show a leak
    which was there all the time. From ten minutes on in all, the rig's own noise is learnt too, in
    each regime: standstill, creep, loaded, fast, and the rest of the motion. How often the detector
    will then accuse a healthy rig is printed, with how sure that is.

    With --onto, what has changed since the first baseline is capped: a leak that grows slowly is
    refused, however small its steps.
    """
    problems = Problems()
    contents = []
    earlier: Baseline | None = None
    with problems.collected():
        assumed = load_model(model)
        earlier = None if onto is None else load_baseline(onto, assumed)
    if onto is not None and model_error is not None:
        problems.add(
            "--model-error: has no effect with --onto, whose noise was learnt; leave it out"
        )
    if not out.parent.is_dir():
        problems.add(f"--out: {out.parent} is no folder; make it first")
    for recording in recordings:
        with problems.collected():
            contents.append(read_recording(recording))
    seen: dict[str, Recording] = {}
    for content in contents:
        first = seen.setdefault(content.content_hash(), content)
        if content is not first:
            problems.add(f"{content.source}: the same samples as {first.source}; give them once")
    if problems.found:
        return problems.report()
    if earlier is not None:
        if doubt := baseline_doubt(str(onto), earlier):
            click.echo(f"warning: {doubt}", err=True)
        learnt = accepted_onto(earlier, contents, assumed)
    else:
        learnt = learn_baseline(contents, assumed, learn_noise=model_error is None)
        if model_error is not None:
            learnt = replace(learnt, model_error=model_error)
    write_baseline(learnt, out)
    number = len(contents)
    words = f"learnt from {number} healthy recording{'s' if number > 1 else ''}"
    click.echo(f"{out}: {words}" + (f", on from {onto}" if onto else ""))
    if learnt.noise is not None:
        _print_noise(learnt.noise)
    elif model_error is None:
        seconds = sum(float(each.time_s[-1] - each.time_s[0]) for each in contents)
        click.echo(
            f"the rig's own noise was not learnt: that takes {LEAST_LEARNING_S / 60.0:.0f} min of "
            f"recordings, these are {seconds / 60.0:.1f} min; the detector allows for what any rig "
            "may need"
        )
    if learnt.accepted:
        _print_accepted(learnt)
    return 0


def _print_noise(noise: LearntNoise) -> None:
    rows = []
    for name in REGIMES:
        fields = noise_content(noise)["regimes"].get(name)
        if fields is not None:
            rows.append(_row(name, fields))
    right = ("minutes", "noise, L/min", "between chambers", "from block to block")
    Screen().print_table(("regime", *right), rows, right=right)
    for rate, (low, high) in expected_alarms(noise).items():
        click.echo(
            f"{rate:g} a day set: {_figure(low)} to {_figure(high)} expected, "
            f"from {noise.tail.hours:.1f} h"
        )


def _figure(rate: float) -> str:
    """Return a rate to a tenth, or to a whole number from 10 on."""
    return f"{rate:.0f}" if rate >= 10.0 else f"{rate:.1f}"


def _row(name: str, fields: dict[str, float]) -> Sequence[str]:
    return (
        name.replace("_", " "),
        f"{fields['seconds'] / 60.0:.1f}",
        f"{fields['noise_L_per_min']:.4f}",
        f"{fields['chambers']:+.2f}",
        f"{fields['lasting']:.2f}",
    )


def _print_accepted(learnt: Baseline) -> None:
    hidden = max(learnt.accepted[-1].hidden)
    click.echo(
        f"accepted {len(learnt.accepted)} times since commissioning: a leak of {hidden:.3f} L/min "
        "that began since then would look normal"
    )
