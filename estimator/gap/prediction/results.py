"""What the workflow finds, as the report, `gap.json` and the model file tell it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from estimator.gap.plant import Array

Verdict = Literal["adequate", "missing_effect", "unknown_effect", "inconclusive"]
Written = Literal["as given", "refitted", "with effects"]
"""What the model written is: the one given, or what was fitted."""


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, SI.

    Attributes:
        key: in the effect, or the parameter's name for a nuisance.
        parameter: of the plant.
        value: fitted.
        lower: end of the interval.
        upper: end of the interval.
        unit: SI.
        before: value in the model as given.
        at_an_end: of a nuisance, whether it came to an end of its tolerance.
    """

    key: str
    parameter: str
    value: float
    lower: float
    upper: float
    unit: str
    before: float
    at_an_end: bool = False


@dataclass(frozen=True)
class Rival:
    """Another effect that could be the cause as well, or was excluded.

    Attributes:
        effect: its name.
        share: part of the named effect's gain that it reaches.
        z: normal deviate of what it explains less.
        cosine: of the two signatures, nuisances projected out.
        why: on principle, if there is a reason.
    """

    effect: str
    share: float
    z: float
    cosine: float
    why: str = ""


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the model lacked.

    Attributes:
        name: of the catalogue.
        equation: what it adds.
        where: equation or channel it enters.
        parameters: its estimates.
        gain: of the cost, by which it was named.
        bar: what the gain had to pass.
        z: of the gain, by the scatter of blocks of half a second.
        indistinguishable: at most two others that this data cannot exclude.
        excluded: others that were tried and are worse.
        unseen: what of it cannot be told on principle.
        held_out_z: normal deviate of what it gains on the held-out recordings; NaN where these
            hardly move what it acts on.
    """

    name: str
    equation: str
    where: str
    parameters: tuple[Estimate, ...]
    gain: float
    bar: float
    z: float
    indistinguishable: tuple[Rival, ...] = ()
    excluded: tuple[Rival, ...] = ()
    unseen: str = ""
    held_out_z: float = float("nan")


@dataclass(frozen=True)
class Curve:
    """What disturbance of an equation would explain the rest, against a region.

    Attributes:
        equation: name.
        region: name.
        at: float64 (m,), of the region, SI.
        values: float64 (m,), disturbance, SI.
        errors: float64 (m,), standard errors.
        unit: of the values, SI.
        region_unit: SI.
        shown: unit shown and factor, of the values; `region_shown` likewise.
        gain: in cost.
        share: of the excess over the noise floor that it explains.
    """

    equation: str
    region: str
    at: Array
    values: Array
    errors: Array
    unit: str
    region_unit: str
    shown: tuple[str, float]
    region_shown: tuple[str, float]
    gain: float
    share: float


@dataclass(frozen=True)
class Band:
    """Mean square of a channel's innovations between two frequencies, in predicted variances.

    Attributes:
        low, high: Hz.
        before: of the model as given.
        after: of the model as written.
        floor: of a rig that is exactly that model, on the same course.
    """

    low: float
    high: float
    before: float
    after: float
    floor: float


@dataclass(frozen=True)
class ChannelGap:
    """Prediction error of a channel over the horizon, held out.

    Attributes:
        channel: column.
        before: mean square over the noise variance, of the model as given.
        after: of the model as written.
        floor: of a rig that is exactly the model, on the same course.
        rms_before: excess over the floor, SI.
        rms_after: likewise.
        unit: SI; `shown`: unit shown and factor.
        whiteness_before: autocorrelation of the innovations at one sample.
        whiteness_after: likewise.
        whiteness_floor: likewise, of the twin.
        bands: power of the innovations by frequency.
        scatter: of `after - floor` by chance, as twins scatter: one standard deviation.
    """

    channel: str
    before: float
    after: float
    floor: float
    rms_before: float
    rms_after: float
    unit: str
    shown: tuple[str, float]
    whiteness_before: float
    whiteness_after: float
    whiteness_floor: float
    bands: tuple[Band, ...] = ()
    scatter: float = 0.0


@dataclass(frozen=True)
class FreeRun:
    """A few seconds in free simulation beside the recording, float64 (m,) each."""

    source: str
    time_s: Array
    channel: str
    unit: str
    shown: tuple[str, float]
    measured: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class Separation:
    """An experiment that would settle which of several effects it is.

    Attributes:
        effects: not told apart so far.
        motion: in words.
        campaign: of a campaign file ready to run, as nested mappings.
        cosine: of the signatures in that motion, nuisances projected out.
        z: normal deviate by which the right one would be better, predicted.
    """

    effects: tuple[str, ...]
    motion: str
    campaign: Mapping[str, Any]
    cosine: float
    z: float


@dataclass(frozen=True)
class DetectionLimit:
    """The smallest size of an effect that these motions would show."""

    effect: str
    key: str
    size: float
    unit: str


@dataclass(frozen=True)
class Check:
    """What a revised model amounts to, tested as if it were given, on a run of its own.

    Attributes:
        verdict: on it.
        effects: that it lacks, too.
        gap_before: of the model first given, on this run.
        gap_after: of the revised one, nothing refitted.
        scatter: of that by chance, one standard deviation: where a ram sticks and slips, twins of
            the same rig differ by as much.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    gap_before: float
    gap_after: float
    scatter: float = 0.0


@dataclass(frozen=True)
class Round:
    """A round of closing a gap on a rig: what was run, and what is known since.

    Attributes:
        why: it was run.
        motions: run in it, by name.
        recordings: made in it.
        verdict: by all recordings up to it.
        effects: likewise.
        check: of the model revised so far; None if there was nothing to check, or it could be
            settled first which effect it is.
    """

    why: str
    motions: tuple[str, ...]
    recordings: tuple[str, ...]
    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    check: Check | None = None


@dataclass(frozen=True)
class AddedDisturbance:
    """An unknown disturbance in symbols as it was added to the model.

    Attributes:
        equation: it was added to.
        text: its terms in symbols with units, refitted together with the nuisances.
        estimates: of its sizes and places, SI.
        values: of all parameters of the model with it.
        explained: part of the excess over the floor in the identification data.
        gap: mean of the channels' excess over the floor held out, in units of the noise variance,
            of the model with it.
        channels: the same by channel; `before` is that of the model as given.
    """

    equation: str
    text: str
    estimates: tuple[Estimate, ...]
    values: dict[str, float]
    explained: float
    gap: float = float("nan")
    channels: tuple[ChannelGap, ...] = ()


@dataclass
class GapResult:
    """What the workflow found.

    Attributes:
        verdict: adequate, missing_effect, unknown_effect or inconclusive.
        reasons: of the verdict, in words.
        effects: named, most important first.
        refitted: nuisances, with their intervals, whether or not the model written has them.
        channels: gap on the held-out recordings by channel.
        gap_before: mean of the channels' excess over the floor, in units of the noise variance.
        gap_after: likewise, of the model as written.
        explained: part of the excess over the floor in the identification data that was explained.
        where: disturbances that explain the disagreement, largest first, before anything was added.
        rest: the same after all that was named was added.
        term: an unknown effect in symbols with units, with the equation it enters; empty without.
        added: that term in the model, if the model can hold it and is better for it.
        limits: smallest sizes that these motions would show, by effect.
        experiments: what to run to settle ambiguities.
        free_runs: short free runs, for the eye.
        values: of all parameters, as written.
        names: effects switched on in the model written.
        as_given: whether the model written is the one given, with nothing of `refitted`: nothing
            was fitted, or it would predict worse.
        identification: sources and content hashes of the recordings fitted to.
        holdout: of those held out.
        seconds: of recordings used: identification, holdout.
        rounds: of closing the gap on a rig; none where recordings were given.
        ended_by: what ended the rounds before their time, such as a trip of the rig.
    """

    verdict: Verdict
    reasons: list[str]
    effects: list[NamedEffect] = field(default_factory=list)
    refitted: list[Estimate] = field(default_factory=list)
    channels: list[ChannelGap] = field(default_factory=list)
    gap_before: float = float("nan")
    gap_after: float = float("nan")
    explained: float = float("nan")
    where: list[Curve] = field(default_factory=list)
    rest: list[Curve] = field(default_factory=list)
    term: str = ""
    added: AddedDisturbance | None = None
    limits: list[DetectionLimit] = field(default_factory=list)
    experiments: list[Separation] = field(default_factory=list)
    free_runs: list[FreeRun] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    as_given: bool = False
    identification: list[tuple[str, str]] = field(default_factory=list)
    holdout: list[tuple[str, str]] = field(default_factory=list)
    seconds: tuple[float, float] = (0.0, 0.0)
    rounds: list[Round] = field(default_factory=list)
    ended_by: str = ""

    @property
    def written(self) -> Written:
        """Return which model was written: as given, refitted, or with effects."""
        if self.as_given:
            return "as given"
        return "with effects" if self.effects else "refitted"
