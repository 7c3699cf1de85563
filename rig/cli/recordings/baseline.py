"""`rig baseline` learns from healthy recordings what the detector may assume of a rig."""

from dataclasses import replace
from pathlib import Path

import click

from estimator.accounts import MOST_MODEL_ERROR
from estimator.leaks import learn_baseline, write_baseline
from rig.cli.application import Problems
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
    default=1.0,
    show_default=True,
    help="Factor on what the detector allows for errors of the model; 0: it is exact.",
)
def command(recordings: tuple[str, ...], out: Path, model: str, model_error: float) -> int:
    """Learn from healthy recordings of a rig what is normal for it, for `rig replay --baseline`.

    Recordings that do not look healthy are refused, and so are recordings that together show a leak
    which was there all the time.
    """
    problems = Problems()
    contents = []
    with problems.collected():
        assumed = load_model(model)
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
    write_baseline(replace(learn_baseline(contents, assumed), model_error=model_error), out)
    number = len(contents)
    click.echo(f"{out}: learnt from {number} healthy recording{'s' if number > 1 else ''}")
    return 0
