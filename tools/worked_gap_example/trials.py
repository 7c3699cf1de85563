"""Makes the rigs and recordings of the worked example, and lets the detector judge them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from math import exp, log
from pathlib import Path
from typing import Final

import numpy as np
from rich.progress import track

from estimator.accounts.flow import reference_drop
from estimator.leaks.replaying import replay
from rig.configuration.models.model import load_model
from rig.plant import NOMINAL, Model
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.hidden_effects.drawn_trials import drawn_nuisances
from tools.hidden_effects.menu import with_effects
from tools.hidden_effects.motions import drawn
from tools.hidden_effects.physics import P1, P2, TANK, TICK
from tools.hidden_effects.recordings import COLUMNS, Recorded, record, write
from tools.hidden_effects.rig_values import TABLE, RigValues
from tools.hidden_effects.trials import sources_digest
from tools.hidden_effects.workflow import rig_gap

SECONDS: Final = 30.0
ONSET_S: Final = 12.0
SIZES: Final = (0.03, 0.3)
"""Smallest and largest leak, L/min at its reference drop; sizes are drawn log-uniformly."""
SETTLED_AFTER_S: Final = 2.0
"""A leak's true flow is its mean from this time after the onset on, s, as the detector's is."""
OPENING: Final = {
    "external_leakage_1": "opening_leak_1",
    "external_leakage_2": "opening_leak_2",
    "internal_leakage": "opening_leak_across",
}
MOTIONS: Final = ("multisine", "steps", "sines", "pseudorandom", "ramps", "sweep")


@dataclass(frozen=True)
class Case:
    """A hidden effect and the number of recordings that are judged of its rig.

    Attributes:
        effect, value: the hidden effect, and its parameter `value` in SI.
        found: whether `rig gap` makes the revised model; otherwise the true model is used.
        healthy, leaks: number of recordings without and with a leak.
    """

    effect: str
    value: float
    found: bool = True
    healthy: int = 30
    leaks: int = 60


CASES: Final = (
    Case("valve_underlap_leakage", 8e-6),
    Case("valve_deadband", 1e-5),
    Case("internal_leakage", 4e-9),
)
PLAIN: Final = tuple(
    Case(effect, value, False, 8, 12)
    for effect, value in (
        ("pressure_1_gain", 0.85),
        ("valve_flow_asymmetry", 0.25),
        ("return_back_pressure", 1.5e13),
        ("supply_droop", 1.5e13),
        ("entrained_air", 0.05),
        ("position_gain", 1.08),
        ("pressure_lag", 0.03),
        ("spool_null_bias", 4e-5),
    )
)
"""Cases with effects that should not disturb the detector, at the largest plausible size."""


@dataclass(frozen=True)
class Heard:
    """The detector's judgement of one recording with one model.

    Attributes:
        verdict: the last verdict.
        alarm_s: when a verdict was first an alarm; None if none was.
        named_s: when the detector first came to its last verdict; None if that is no alarm.
        flow, low, high: estimated flow of the leak and its 95 % interval, L/min; None if the
            detector estimated none.
    """

    verdict: str
    alarm_s: float | None
    named_s: float | None
    flow: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Trial:
    """The judgements of one recording.

    Attributes:
        leak: name of the leak that opened at `ONSET_S`; None for a healthy rig.
        flow: true mean flow of the leak (`true_flow`), L/min; 0 for a healthy rig.
        nominal, revised: the detector's judgement with the nominal and with the revised model.
    """

    leak: str | None
    flow: float
    nominal: Heard
    revised: Heard


def hiding(case: Case, seed: int) -> RigValues:
    """Return a rig with the case's effect; its nuisances are drawn within healthy tolerances."""
    nuisances = drawn_nuisances(np.random.default_rng([seed, 1]))
    return with_effects(TABLE._replace(**nuisances), {case.effect: {"value": case.value}})


def recorded(rig: RigValues, motion: str, seed: Sequence[int], seconds: float) -> Recorded:
    """Draw a motion of the kind `motion` by a seed, run it on a rig, and return the recording."""
    rng = np.random.default_rng(seed)
    return record(rig, drawn(motion, rng, round(seconds / TICK)), rng)


def kept_folder(case: Case, out: Path, seed: int) -> Path:
    """Return the folder in `out` for the model and the trials of a case; make it if missing.

    Its name differs between any two seeds, cases and states of the sources (`sources_digest`, and
    this module), so that nothing in it was made otherwise.
    """
    made_from = sources_digest(), Path(__file__).read_text(encoding="utf-8"), repr(case)
    key = sha256("\n".join(made_from).encode()).hexdigest()[:12]
    folder = out / f"{case.effect}-{seed}-{key}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def revised_model(case: Case, rig: RigValues, out: Path, seed: int) -> Model:
    """Return the revised model of a rig.

    If `case.found` is False, it is the nominal model with the case's effect. Otherwise `rig gap`
    writes it into the `kept_folder`, from recordings of `rig` drawn by `seed`. A model that is
    there from before is only read; `rig` must thus follow from case and seed (`hiding`).

    Raises:
        WorkflowFailedError: `rig gap` did not end in a result.
    """
    if not case.found:
        return Model().with_effect(case.effect, value=case.value)
    folder = kept_folder(case, out, seed)
    written = folder / "found" / "model.yaml"
    if not written.is_file():
        files = []
        motions = {"identify_1": "multisine", "identify_2": "steps", "holdout": "sines"}
        for place, (name, motion) in enumerate(motions.items()):
            files.append(folder / f"{name}.csv.gz")
            write(recorded(rig, motion, [seed, 2, place], SECONDS).table, files[-1])
        answer = rig_gap(files[:2], files[2], folder / "found")
        (folder / "answer.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    return load_model(str(written))


def leaking(rig: RigValues, leak: str, flow: float) -> RigValues:
    """Return the rig with a leak that opens at `ONSET_S`; `flow` is in L/min at reference drop."""
    coefficient = flow * LITRE_PER_MINUTE / reference_drop(NOMINAL, leak) ** 0.5
    return rig._replace(opens_at=ONSET_S, **{OPENING[leak]: coefficient})


def runs(case: Case, rig: RigValues, seed: int) -> Iterator[tuple[str | None, float, Recorded]]:
    """Yield each recording of a case as (leak or None, its true flow in L/min, recording)."""
    for number in range(case.healthy + case.leaks):
        motion = MOTIONS[number % len(MOTIONS)]
        draws = [seed, 3, number]
        if number < case.healthy:
            yield None, 0.0, recorded(rig, motion, draws, SECONDS)
            continue
        leak = tuple(OPENING)[number // len(MOTIONS) % len(OPENING)]
        low, high = map(log, SIZES)
        size = exp(np.random.default_rng([*draws, 1]).uniform(low, high))
        values = leaking(rig, leak, size)
        found = recorded(values, motion, draws, SECONDS)
        yield leak, true_flow(values, leak, found), found


def true_flow(rig: RigValues, leak: str, made: Recorded) -> float:
    """Return the true mean flow (L/min) of a leak from `SETTLED_AFTER_S` after its onset on.

    The flow is taken without a sign, and only of the leak that opens at `ONSET_S`.
    """
    states = made.truth[round((ONSET_S + SETTLED_AFTER_S) / TICK) :]
    ends = {
        "external_leakage_1": states[:, P1] - states[:, TANK],
        "external_leakage_2": states[:, P2] - states[:, TANK],
        "internal_leakage": states[:, P1] - states[:, P2],
    }
    coefficient = getattr(rig, OPENING[leak])
    return float(np.mean(coefficient * np.sqrt(np.abs(ends[leak])))) / LITRE_PER_MINUTE


def recording_of(made: Recorded) -> Recording:
    """Return a recording of the independent rig as a `Recording` of the product."""
    return Recording(
        {name: np.ascontiguousarray(made.table[:, i]) for i, name in enumerate(COLUMNS)}
    )


def heard(recording: Recording, model: Model) -> Heard:
    """Let the detector judge a recording with a model, and return its judgement."""
    result = replay(recording, model)
    alarms = [time_s for time_s, held in result.history if held.names_a_fault]
    final = result.decision
    sized = final.interval_m3_per_s
    low, high = (None, None) if sized is None else (s / LITRE_PER_MINUTE for s in sized)
    flow = final.leak_m3_per_s
    return Heard(
        final.verdict,
        alarms[0] if alarms else None,
        result.detected_at_s,
        None if flow is None else flow / LITRE_PER_MINUTE,
        low,
        high,
    )


def tried(case: Case, out: Path, seed: int) -> list[Trial]:
    """Run the trials of a case, keep them in `out` and return them; kept ones are only read.

    Kept trials count only for the same case, seed and sources (`kept_folder`).

    Raises:
        WorkflowFailedError: `rig gap` did not end in a result.
    """
    kept = kept_folder(case, out, seed) / "trials.json"
    if kept.is_file():
        return [_trial(fields) for fields in json.loads(kept.read_text(encoding="utf-8"))]
    rig = hiding(case, seed)
    model = revised_model(case, rig, out, seed)
    found = []
    count = case.healthy + case.leaks
    for leak, flow, made in track(runs(case, rig, seed), case.effect, count, transient=True):
        recording = recording_of(made)
        found.append(Trial(leak, flow, heard(recording, Model()), heard(recording, model)))
    kept.write_text(json.dumps([asdict(trial) for trial in found]) + "\n", encoding="utf-8")
    return found


def _trial(fields: dict[str, object]) -> Trial:
    nominal, revised = fields["nominal"], fields["revised"]
    assert isinstance(nominal, dict)
    assert isinstance(revised, dict)
    leak, flow = fields["leak"], fields["flow"]
    assert leak is None or isinstance(leak, str)
    assert isinstance(flow, float)
    return Trial(leak, flow, Heard(**nominal), Heard(**revised))
