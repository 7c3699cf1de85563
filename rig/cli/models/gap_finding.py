"""The work of `rig gap`: it reads recordings, finds the gap, and writes the page and the model."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
import yaml
from rich.text import Text

from estimator.gap import Discovered, GapResult, Plant, Wanted, find_gap
from rig.cli.application import EXIT_CRASHED, EXIT_STOPPED, Problems, ending
from rig.cli.screen import Screen
from rig.configuration import PlantModel, Rig, load_columns, load_model, load_plant, load_rig
from rig.io import today
from rig.plant import TICK, Model
from rig.recording import Column, Recording, RecordingError, read_measured, replacing
from rig.report.calibrations import CalibrationRow, calibration_rows
from rig.report.gap import (
    estimated,
    extent,
    gap_page,
    gap_words,
    headline,
    in_words,
    left_words,
    share,
    where_words,
)
from rig.runner.campaign import Pace
from rig.runner.experiments import (
    CHECK,
    EXPERIMENT_S,
    FITTED,
    HELD,
    ROUNDS,
    ApartError,
    answer,
    apart,
    close_gap,
    gap_figures,
    motions_campaign,
    provenance_of,
    rig_plant,
    room_of,
)
from rig.runner.outcomes import calibrations_recorded, calibrations_used, sensors_of

from .experiments import experiment, print_motions, rig_time

MODEL_FILE: Final = "model.yaml"
REPORT_FILE: Final = "report.html"
FIGURES_FILE: Final = "gap.json"
EXPERIMENT_FILE: Final = "experiment.yaml"
OLD_TERM_FILE: Final = "model_with_term.yaml"
SELDOM: Final = 5
"""Greatest usual distance of a rig's readings, ms. With 10 ms a rig that lacks nothing came out as
`unknown_effect`, with 4 ms as `adequate`."""

_STYLES: Final = {"adequate": "green", "missing_effect": "red", "unknown_effect": "red"}


@dataclass(frozen=True)
class Asked:
    """The arguments and options of `rig gap`, by name, as `rig gap --help` explains them.

    `outside` is the option --plant. Of an option that was not given, the value is its default.
    """

    recordings: tuple[str, ...]
    holdout: tuple[str, ...]
    live: bool
    rig: str | None
    pace: Pace | None
    profile: str | None
    rounds: int | None
    dry_run: bool
    model: str
    outside: str | None
    out: Path | None
    columns: Path | None
    no_discovered: bool
    accept_leaks: bool
    as_json: bool


def found_by(asked: Asked) -> int:
    """Find the gap that is asked for, write the files, show the finding; return the exit code.

    All problems of the input go to stderr together; then nothing is written and the code is 2. If
    the rig ended the experiment, the reason is on stderr and the code is `EXIT_STOPPED`. With
    `dry_run` the motions are only printed.
    """
    problems = Problems()
    own: PlantModel | None = None
    with problems.collected():
        if asked.outside is None:
            tested = load_model(asked.model)
        else:
            own = load_plant(asked.outside, asked.model, (*asked.recordings, *asked.holdout))
    if asked.outside is not None and own is None:
        # Only the plant says which channels a recording must have.
        return problems.report()
    if asked.live:
        if asked.recordings or asked.holdout or asked.outside or asked.rig is None:
            limit = "makes its own recordings, on a hydraulic rig"
            problems.add(f"--live: {limit}; give --rig, no recordings and no --plant")
        else:
            with problems.collected():
                rig = load_rig(asked.rig)
        if asked.dry_run and not problems.found:
            return _show_motions(rig, tested)
    else:
        if not asked.recordings or not asked.holdout:
            problems.add("give recordings to fit to, and some to judge with after --holdout")
        if any((asked.rig, asked.pace, asked.profile, asked.dry_run, asked.rounds)):
            named = "--rig, --pace, --stream, --rounds, --dry-run"
            problems.add(f"{named}: are of motions on a rig; give --live")
    out = asked.out
    if out is None:
        problems.add("--out: name a folder for what is found")
    elif out.exists() and not out.is_dir():
        problems.add(f"--out: {out} is a file; name a folder")
    columns = None
    if asked.columns is not None and (asked.outside is not None or asked.live):
        limit = "is for recordings of a rig; a plant's model file names them under channels"
        problems.add(f"--columns: {limit}")
    elif asked.columns is not None:
        with problems.collected():
            columns = load_columns(asked.columns)
    read = own.read if own is not None else partial(_read_of_rig, columns=columns)
    fitted, judged = _read(asked.recordings, read, problems), _read(asked.holdout, read, problems)
    _refuse_repeated(fitted, judged, problems)
    if problems.found or out is None:
        return problems.report()
    wanted = Wanted(discovered=not asked.no_discovered, leaks=asked.accept_leaks)
    if asked.live:
        result = _close_on_rig(rig, tested, asked, out, wanted)
        plant, name = rig_plant(tested, rig.sensors, room_of(rig)), tested.name
    else:
        if own is not None:
            plant, name = own.plant, own.name
        else:
            plant, name = rig_plant(tested, sensors_of(fitted[0])), tested.name
        find = partial(find_gap, wanted=wanted, said=_say)
        unread = _unread([*fitted, *judged]) if own is None else []
        result = _unjudged(fitted, judged, plant) if unread else find(fitted, judged, plant)
        result.reasons += unread
        result.reasons += _noted([*fitted, *judged])
        result.reasons += [plant.why_no_layout] if plant.why_no_layout else []
    if asked.live:
        calibrated = calibration_rows(calibrations_used(rig, (today(),)), rig.uncalibrated)
    else:
        calibrated = calibration_rows(*calibrations_recorded((*fitted, *judged)))
    _write(result, plant, name, out, (asked.rig or "simulated", asked.model), calibrated)
    if asked.as_json:
        click.echo(json.dumps(answer(result), allow_nan=False))
    else:
        _show(result, out)
    if not result.ended_by:
        return 0
    click.echo(f"rig: {result.ended_by}", err=True)
    return EXIT_STOPPED


def _show(result: GapResult, out: Path) -> None:
    """Show what was found, and which files were written to the folder `out`."""
    screen = Screen()
    for line in _lines(result):
        screen.print(line)
    headings = ("", "name", "value, 95 % interval", "was", "evidence", "may as well be")
    screen.print_table(headings, _rows(result), fold=headings)
    screen.print(f"report: {out / REPORT_FILE}")
    screen.print(f"model: {out / MODEL_FILE}")
    if (out / EXPERIMENT_FILE).is_file():
        screen.print(f"experiment: {out / EXPERIMENT_FILE}")


def _say(words: str) -> None:
    """Write a line on stderr that says what is being done; with --json stdout has only the JSON."""
    click.echo(f"rig: {words}", err=True)


def _read_of_rig(name: str, columns: Mapping[str, Column] | None) -> Recording:
    """Return a recording of the rig in samples of 1 ms; NaN stands for a spool without a sensor.

    Raises:
        RecordingError: lists every problem of the file. Rows more than 1 ms apart lack commands of
            the loop, which the search would take for effects of the valve.
    """
    recording = read_measured(name, optional=("spool_m",), columns=columns)
    assert recording.sampling is not None
    if recording.sampling.period > 1.01 * TICK:
        raise RecordingError.of_file(
            name, f"has a row every {recording.sampling.period * 1e3:.4g} ms",
            "record the command at 1 kHz; readings may be missing in some rows",
            "must be 1 ms or less, as the valve follows commands in between",
        )  # fmt: skip
    return recording


def _unread(recordings: Sequence[Recording]) -> list[str]:
    """Return why recordings cannot be searched: position or pressures were read too seldom.

    The reasons are sentences, each given once; [] if they were read often enough. Interpolated
    readings do not count as read.
    """
    reasons = []
    for recording in recordings:
        interpolated = {} if recording.sampling is None else recording.sampling.interpolated
        if set(interpolated) - {"spool_m"}:
            reasons.append(
                "rows between the readings say nothing of the rig, and the readings alone are too "
                "far apart to tell what sticks and slips; record every reading as it is"
            )
        for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa"):
            apart = np.diff(np.flatnonzero(np.isfinite(recording[name])))
            if name not in interpolated and len(apart) and np.median(apart) > SELDOM:
                reasons.append(
                    f"{name} has a reading every {np.median(apart):.0f} ms, {SELDOM} ms at most "
                    "can tell what sticks and slips; record more readings"
                )
    return list(dict.fromkeys(reasons))


def _unjudged(fitted: Sequence[Recording], judged: Sequence[Recording], plant: Plant) -> GapResult:
    """Return the result of recordings that are not searched: `inconclusive`, the model as given."""
    result = GapResult("inconclusive", [], values=dict(plant.nominal), as_given=True)
    result.identification = [(r.source, r.content_hash()) for r in fitted]
    result.holdout = [(r.source, r.content_hash()) for r in judged]
    lengths = sum(map(len, fitted)), sum(map(len, judged))
    result.seconds = (lengths[0] * plant.period, lengths[1] * plant.period)
    return result


def _noted(recordings: Sequence[Recording]) -> Iterator[str]:
    """Yield in words what is unusual about how the recordings were sampled, each thing once."""
    notes: dict[str, list[str]] = {}
    for recording in recordings:
        for note in () if recording.sampling is None else recording.sampling.notes():
            notes.setdefault(note, []).append(Path(recording.source).name)
    for note, names in notes.items():
        every = len(names) == len(recordings)
        yield note if every else f"{', '.join(names)}: {note}"


def _read(
    names: Sequence[str], read: Callable[[str], Recording], problems: Problems
) -> list[Recording]:
    """Return the recordings that can be read; add the problems of the others to `problems`."""
    found = []
    for name in names:
        with problems.collected():
            found.append(read(name))
    return found


def _refuse_repeated(
    fitted: Sequence[Recording], judged: Sequence[Recording], problems: Problems
) -> None:
    """Add a problem for each recording whose samples were given before: evidence counts once."""
    seen: dict[str, tuple[Recording, bool]] = {}
    for recording, held in [*((r, False) for r in fitted), *((r, True) for r in judged)]:
        first, first_held = seen.setdefault(recording.content_hash(), (recording, held))
        same = f"{recording.source} holds the same samples as {first.source}"
        if held != first_held:
            problems.add(f"--holdout: {same}, which is fitted to; hold out a recording of its own")
        elif first is not recording:
            same = f"{recording.source}: holds the same samples as {first.source}"
            problems.add(f"{same}; give it once")


def _write(
    result: GapResult,
    plant: Plant,
    model: str,
    out: Path,
    references: tuple[str, str],
    calibrations: Sequence[CalibrationRow],
) -> None:
    """Write model, report, figures and experiment: all of them, or, if one fails, none.

    An experiment of an earlier run is removed where this result has none, and so is the file
    `model_with_term.yaml` that earlier versions wrote.

    Args:
        result: result of the gap workflow.
        plant: the plant whose model was tested.
        model: name of the model that was tested.
        out: the folder; it is made if missing.
        references: rig and model, by path or name, of the experiment's campaign.
        calibrations: rows of the page's table of calibrations.
    """
    command = ("rig", *sys.argv[1:])
    page = gap_page(result, plant, model, command, calibrations)
    figures = json.dumps(gap_figures(result, plant), indent=1, allow_nan=False)
    campaign = next((each.campaign for each in result.experiments if each.campaign), None)
    out.mkdir(parents=True, exist_ok=True)
    if campaign is None:
        (out / EXPERIMENT_FILE).unlink(missing_ok=True)
    (out / OLD_TERM_FILE).unlink(missing_ok=True)
    with ExitStack() as stack:
        written, drawn, listed = (
            stack.enter_context(replacing(out / name))
            for name in (MODEL_FILE, REPORT_FILE, FIGURES_FILE)
        )
        plant.write(result.values, result.names, provenance_of(result, command), written)
        drawn.write_text(page, encoding="utf-8")
        listed.write_text(figures + "\n", encoding="utf-8")
        if campaign is not None:
            to_run = stack.enter_context(replacing(out / EXPERIMENT_FILE))
            to_run.write_text(experiment_file(campaign, *references), encoding="utf-8")


def _lines(result: GapResult) -> Iterator[Text | str]:
    """Yield the lines that say in words what was found."""
    yield Text(f"{result.verdict}: {headline(result)}", _STYLES.get(result.verdict, "yellow"))
    yield from result.reasons
    if result.where:
        yield f"where: {where_words(result.where[0])}"
    yield gap_words(result)
    yield from left_words(result)
    for each in result.experiments[:1]:
        effects = " and ".join(map(in_words, each.effects))
        if each.campaign:
            yield f"to tell {effects} apart: {each.motion} (predicted z {each.z:.0f})"
        else:
            yield f"{effects} cannot be told apart: {each.motion}"


def _rows(result: GapResult) -> Iterator[tuple[str | Text, ...]]:
    """Yield the cells of a row for each effect, discovered disturbance and nuisance."""
    for effect in result.effects:
        others = ", ".join(rival.effect for rival in effect.indistinguishable)
        evidence = f"z = {effect.z:.1f}"
        for each in effect.parameters:
            name = Text(effect.name if each.key == "value" else f"{effect.name}.{each.key}", "bold")
            yield "missing", name, estimated(each), f"{each.before:.4g}", evidence, others
        if effect.correction is not None:
            yield _of_discovered(effect.correction, "corrected")
    for disturbance in result.discovered:
        yield _of_discovered(disturbance, _how(disturbance))
    how = "refitted, not kept" if result.as_given else "refitted"
    for each in result.refitted:
        end = "at the end of its tolerance" if each.at_an_end else ""
        yield how, each.key, estimated(each), f"{each.before:.4g}", end, ""


def _how(each: Discovered) -> str:
    """Return whether the model written has a discovered disturbance, in the table's words."""
    if each.in_model:
        return "discovered"
    if each.name == "stuck_channel":
        return "discovered, its readings left out"
    return f"discovered, {'suspected leak, ' if each.suspected_leak else ''}left out"


def _of_discovered(each: Discovered, how: str) -> tuple[str | Text, ...]:
    """Return the cells of a discovered disturbance; `how` says whether the model written has it."""
    name = Text(f"{in_words(each.name)} in {each.where}", "bold")
    evidence = f"z = {each.z:.1f}, {share(each.share)}" if isfinite(each.z) else ""
    others = ", ".join(map(in_words, each.could_also_be))
    return how, name, extent(each), "0", evidence, others


def _show_motions(rig: Rig, assumed: Model) -> int:
    """Print the motions of the first round as they would run, and move nothing; return 0."""
    campaigns = (
        motions_campaign("held out", HELD, rig, assumed, 1),
        motions_campaign("round 1", FITTED, rig, assumed, 1),
        motions_campaign("check", CHECK, rig, assumed, 501),
    )
    click.echo(
        f"gap of {rig.name} to the model {assumed.name}: {rig_time(campaigns)} of rig time in "
        f"one round; each experiment {EXPERIMENT_S:g} s more, with a check after it"
    )
    for campaign in campaigns:
        click.echo(f"{campaign.name}:")
        print_motions(campaign, rig, indent="  ")
    return 0


def _close_on_rig(rig: Rig, given: Model, asked: Asked, out: Path, wanted: Wanted) -> GapResult:
    """Close the gap of a model by motions on a rig, and return the result.

    Args:
        rig: the rig that is moved.
        given: the model to start from.
        asked: the options, with pace and number of rounds.
        out: new or empty folder for the recordings.
        wanted: what the revised model may hold of what is discovered.

    Raises:
        ConfigError: the profile of the live stream cannot be used.
        DirectoryError: the folder cannot be used.
        click.exceptions.Exit: the pace is impossible, the experiment was stopped, a driver failed,
            the rig tripped in a motion, or the search for effects died. The message is on stderr
            already.
    """
    seed = int(datetime.now(UTC).timestamp()) % 1_000_000
    before, after = "rig: nothing was found: ", f"; recordings are in {out}"
    with (
        experiment(
            rig, asked.pace, out, asked.profile, "gap of the model", as_json=asked.as_json
        ) as (_, stop, observer),
        ending(EXIT_CRASHED, ApartError, before=before, after=after),
    ):
        return close_gap(
            rig, given, out, rounds=asked.rounds or ROUNDS, wanted=wanted, pace=asked.pace,
            observer=observer, stop=stop, worker=apart, seed=seed,
        )  # fmt: skip


def experiment_file(campaign: Mapping[str, Any], rig: str, model: str) -> str:
    """Return the text of a campaign file that runs the experiment `campaign` on a rig.

    `rig` and `model` are names or paths; a path to a file is made absolute.
    """
    content = {
        "name": campaign["name"],
        "description": campaign["description"],
        "rig": _reference(rig),
        "model": _reference(model),
        "tests": json.loads(json.dumps(campaign["tests"])),
    }
    head = "# Written by rig gap: tells apart what its recordings could not. Look at it first:\n"
    body = yaml.safe_dump(content, sort_keys=False)
    return f"{head}# rig check this file, then rig run it.\n{body}"


def _reference(reference: str) -> str:
    """Return the absolute path of a file; return the reference unchanged if it is no file."""
    path = Path(reference).expanduser()
    return str(path.resolve()) if path.is_file() else reference
