"""`rig tune` tunes a rig's position loop by an experiment, and writes the gains it proposes."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from math import degrees
from pathlib import Path
from typing import Final

import click

from rig.cli.application import Problems
from rig.cli.option_types import STREAMED, paced
from rig.cli.rig_output import RIG_OUT, refuse_output, refuse_shipped
from rig.configuration import (
    NotAsMeantError,
    Rig,
    control_lines,
    find_rig,
    load_model,
    load_rig,
    rewrite_rig,
    with_control,
)
from rig.io import today
from rig.plant import Model
from rig.recording import replace_text
from rig.report.calibrations import calibration_rows
from rig.report.tuning import hold_line, margin_rows, response_line, tuning_page
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    Tuning,
    exciting_campaign,
    hold_campaign,
    response_campaign,
    run_tuning,
    tuning_figures,
)
from rig.runner.outcomes import calibrations_used
from rig.runner.run_folder import default_directory

from .experiments import experiment, print_motions, rig_time

EXIT_UNSAFE: Final = 1


@click.command()
@click.argument("rig_reference", metavar="RIG")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@paced("Of the experiment: at")
@STREAMED
@click.option("--dry-run", is_flag=True, help="Show the experiment's motions, and move nothing.")
@RIG_OUT
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="A new or empty folder for page and recordings; runs/tune-RIG-TIME if not given.",
)
@click.option("--json", "as_json", is_flag=True, help="One object instead of tables.")
def command(
    rig_reference: str,
    model: str,
    pace: Pace | None,
    profile: str | None,
    dry_run: bool,
    out: Path | None,
    folder: Path | None,
    as_json: bool,
) -> int:
    """Tune the position loop of RIG, a file or a shipped name, by a safe experiment.

    The ram, unloaded, strokes slowly over most of its range with small tones upon the strokes, is
    held under the proposed control, and makes small steps and a sine under the present and the
    proposed one: two minutes, within the rig's limits.

    The section `control` of the rig file is written anew, and the old file is kept beside it as
    FILE.TIME.bak; a shipped rig, given by name, needs --out. Nothing is written if the proposed
    control would leave less than 6 dB or 30 degrees anywhere, or hunts. Also writes tuning.html and
    tuning.json. Exit code 0 tuned, 1 not, 2 bad input, 3 stopped or tripped.
    """
    problems = Problems()
    with problems.collected():
        rig = load_rig(rig_reference)
    with problems.collected():
        assumed = load_model(model)
    refuse_output(problems, out)
    if problems.found:
        return problems.report()
    if dry_run:
        return _show_motions(rig, assumed)
    refuse_shipped(problems, rig_reference, out)
    if problems.found:
        return problems.report()
    file = find_rig(rig_reference)
    begun = datetime.now(UTC)
    directory = folder or default_directory(f"tune-{rig.name}", begun)
    watched = experiment(rig, pace, directory, profile, "tuning", as_json=as_json)
    with watched as (screen, stop, observer):
        found = run_tuning(rig, assumed, directory, pace=pace, observer=observer, stop=stop)
    started = f"{begun:%Y-%m-%d %H:%M}"
    figures = tuning_figures(found)
    replace_text(directory / "tuning.json", json.dumps(figures, indent=1, allow_nan=False) + "\n")
    written = _write(file, out, found, begun) if found.safe else []
    used = calibrations_used(rig, (begun.date(), today()))
    calibrated = calibration_rows(used, rig.uncalibrated)
    replace_text(directory / "tuning.html", tuning_page(found, started, written, calibrated))
    if as_json:
        click.echo(json.dumps(figures | {"written": written}, allow_nan=False))
        return 0 if found.safe else EXIT_UNSAFE
    right = (
        "mm/s for 1 V", "lag, ms", "misfit", "dB before", "° before", "Hz before", "dB after",
        "° after", "Hz after",
    )  # fmt: skip
    screen.print_table(("position, mm", *right), margin_rows(found), right=right)
    for each in found.responses:
        screen.print(response_line(each), soft_wrap=True)
    screen.print(hold_line(found), soft_wrap=True)
    for remark in found.remarks:
        screen.print(f"note: {remark}", soft_wrap=True)
    for line in list(control_lines(found.proposed, ""))[1:]:
        screen.print(line)
    for line in written or ["rig file: unchanged, the proposed control is not safe; see the notes"]:
        screen.print(line, soft_wrap=True)
    screen.print(f"plots: {directory / 'tuning.html'}", soft_wrap=True)
    return 0 if found.safe else EXIT_UNSAFE


def _write(file: Path, out: Path | None, found: Tuning, begun: datetime) -> list[str]:
    """Write the proposed control into the rig file, or to `out`; return what was written, in lines.

    Raises:
        ConfigError: the written file is unusable; the old one is in place again.
        ClickException: the written file does not say what was proposed; as before.
        OSError: a file cannot be written.
    """
    text = file.read_text(encoding="utf-8")
    margins = found.margins_after
    comment = (
        f"by rig tune, {begun:%Y-%m-%d %H:%M} UTC: at least "
        f"{min(each.gain_dB for each in margins):.0f} dB and "
        f"{degrees(min(each.phase for each in margins)):.0f} degrees"
    )
    text = with_control(text, found.proposed, comment)
    try:
        return rewrite_rig(file, out, text, lambda rig: rig.control == found.proposed, begun)
    except NotAsMeantError as error:
        raise click.ClickException(str(error)) from error


def _show_motions(rig: Rig, assumed: Model) -> int:
    """Print every motion of the experiment as it would run, and move nothing; return 0."""
    ahead = replace(rig.control, feedforward="model", feedforward_gain=None)
    campaigns = (
        exciting_campaign(rig, assumed),
        hold_campaign(rig, assumed, ahead, 1),
        response_campaign(rig, assumed, ahead),
    )
    click.echo(f"tuning of {rig.name}: {rig_time(campaigns)} of rig time")
    for campaign in campaigns:
        print_motions(campaign, rig)
    click.echo(
        "the hold and the motions `after` run with the gains that the first part lets propose"
    )
    return 0
