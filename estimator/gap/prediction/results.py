"""These classes hold what the workflow finds, for the report, `gap.json` and the model file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from estimator.gap.plant import Array

Verdict = Literal["adequate", "missing_effect", "unknown_effect", "inconclusive"]
Written = Literal["as given", "refitted", "with effects", "with discovered"]
"""Which model is written: the model as given, the refitted one, one with effects added, or one with
discovered disturbances added and no effects."""
Form = Literal["catalogue", "corrected"]


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, SI.

    Attributes:
        key: key of the effect's knob; for a nuisance the parameter's name.
        parameter: name of the plant's parameter.
        value: fitted value.
        lower: lower end of the interval.
        upper: upper end of the interval.
        unit: SI unit.
        before: value in the model as given.
        at_an_end: whether a nuisance came to an end of its tolerance; False for an effect.
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
    """Another effect that was tried in the place of a named one, as the cause or to be excluded.

    Attributes:
        effect: name of the other effect.
        share: part of the named effect's gain that the other effect reaches.
        z: normal deviate of the gain that it lacks; the greater, the surer it is worse.
        cosine: cosine between the signatures of the two effects, with the nuisances projected out;
            NaN if the model breaks down without both.
        why: reason why the two are the same on principle, in words; empty if there is none.
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
        name: name of the effect in the catalogue.
        equation: what the effect adds to the model, in symbols.
        where: equation or channel that the effect enters.
        parameters: estimates of the effect's parameters.
        gain: by how much the effect lowered the cost when it was named.
        bar: gain that it had to exceed.
        z: normal deviate of the gain, by the scatter of half-second blocks.
        indistinguishable: at most two other effects that these recordings cannot exclude.
        excluded: other effects that were tried and are worse.
        unseen: what recordings cannot show of the effect on principle, in words.
        held_out_z: normal deviate of the effect's gain on the held-out recordings; NaN where these
            hardly show what it acts on.
        correction: disturbance by which the effect's formula is corrected; None if it needs none.
        replaced: whether the model has the correction in the place of the formula, and the
            parameter was read off it.
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
    correction: "Discovered | None" = None
    replaced: bool = False

    @property
    def form(self) -> Form:
        """Return whether the effect's formula is the catalogue's, or was corrected by a curve."""
        return "catalogue" if self.correction is None else "corrected"


@dataclass(frozen=True)
class Discovered:
    """A disturbance that no catalogue holds, as it was found.

    Attributes:
        name: its shape in the lexicon (`estimator.gap.verdict.lexicon`), such as "threshold".
        place: equation, reading or parameter that it enters.
        of: quantity that it depends on; "" for none.
        times: quantity that it is multiplied by; "" for none.
        form: "table", or its form in symbols.
        what: what it does, in one sentence with units and no full stop.
        parts: parts of a rig that make such a shape, in words, likeliest first.
        estimates: of a form in symbols, its size and places with intervals; of a table none.
        at: float64 (knots,), of a table, SI; else empty.
        values: float64 (knots,), of a table, SI; else empty.
        errors: float64 (knots,), standard errors of the values, SI; else empty.
        unit: SI unit of the disturbance.
        of_unit: SI unit of the quantity.
        gain: by how much it lowered the cost when it was added.
        z: normal deviate of the gain, by the scatter of half-second blocks that it was not fitted
            to.
        share: part of the excess over the noise floor that it takes away.
        gap: mean of the channels' excess over the floor on held-out recordings, in noise variances,
            of the model before it was added and of that with it; NaN if it was not measured.
        could_also_be: at most two other explanations that these recordings do not exclude, in
            words.
        suspected_leak: whether it takes oil out of a chamber and grows with the pressure.
        in_model: whether the model written has it.
        experiment: what to run to confirm it, in words.
        curve: the disturbance against its quantity, to be drawn; None if it depends on none.
    """

    name: str
    place: str
    of: str
    times: str
    form: str
    what: str
    parts: str
    estimates: tuple[Estimate, ...]
    at: Array
    values: Array
    errors: Array
    unit: str
    of_unit: str
    gain: float
    z: float
    share: float
    gap: tuple[float, float] = (float("nan"), float("nan"))
    could_also_be: tuple[str, ...] = ()
    suspected_leak: bool = False
    in_model: bool = True
    experiment: str = ""
    curve: "Curve | None" = None

    @property
    def where(self) -> str:
        """Return what the disturbance enters and depends on, as "force balance of position"."""
        of = f"{self.of or 'nothing'}{f' x {self.times}' if self.times else ''}"
        return f"{self.place} of {of}"

    @property
    def text(self) -> str:
        """Return what the disturbance does and what may make it, in one sentence with units."""
        return f"{self.what}; {self.parts} would do this."


@dataclass(frozen=True)
class Curve:
    """A disturbance as a curve against a region, which would explain what the model leaves.

    Attributes:
        equation: name of the equation that the disturbance enters, or "reading of" and a channel.
            For a parameter that drifts it is the parameter's name, and the curve its value.
        region: name of the region, such as "velocity" or "time".
        at: float64 (m,), places in the region, SI.
        values: float64 (m,), disturbance at these places, SI.
        errors: float64 (m,), standard errors of the values; infinite where the motion never came.
        unit: SI unit of the values.
        region_unit: SI unit of the region.
        shown: unit of the values in reports, and the number of such units in one SI unit.
        region_shown: the same for the region.
        gain: by how much the disturbance would lower the cost.
        share: part of the excess over the noise floor that the disturbance explains; 0 if there is
            no excess.
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
    """Mean square of a channel's innovations in one frequency band, in predicted variances.

    Attributes:
        low: lower end of the band, Hz.
        high: upper end of the band, Hz.
        before: mean square with the model as given.
        after: mean square with the model as written.
        floor: mean square for a rig that is exactly the model as written, on the same course.
    """

    low: float
    high: float
    before: float
    after: float
    floor: float


@dataclass(frozen=True)
class ChannelGap:
    """Prediction error of a channel over the horizon, on held-out recordings.

    Attributes:
        channel: name of the recording's column.
        before: mean squared error with the model as given, in noise variances.
        after: the same with the model as written.
        floor: the same for a rig that is exactly the model as written, on the same course.
        rms_before: root mean square of what `before` has above the floor, SI.
        rms_after: the same for `after`.
        unit: SI unit.
        shown: unit used in reports, and the number of such units in one SI unit.
        whiteness_before: correlation of innovations one sample apart, with the model as given.
        whiteness_after: the same with the model as written.
        whiteness_floor: the same for the twins.
        bands: mean squares of the innovations by frequency band.
        scatter: standard deviation by which `after - floor` varies by chance, as twins do, in noise
            variances.
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
    """A few seconds of one channel in free simulation beside the recording, float64 (m,) each.

    Attributes:
        source: where the recording comes from.
        time_s: time since the recording began, s.
        channel: name of the recording's column.
        unit: SI unit.
        shown: unit used in reports, and the number of such units in one SI unit.
        measured: readings; NaN where a reading is not used.
        before: simulation with the model as given.
        after: simulation with the model as written.
    """

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
    """An experiment that would settle which of several effects is the cause.

    Attributes:
        effects: effects between which the recordings do not decide.
        motion: motion of the experiment, in words; if no motion decides, it says so.
        campaign: contents of a campaign file that runs the motion, without its rig and model; empty
            if no motion decides.
        cosine: cosine between the signatures of the named effect and of the rival that the motion
            excludes worst, with the nuisances projected out.
        z: predicted normal deviate by which the named effect would be better than that rival.

    If no motion decides, the last two are those of the best motion; NaN if no motion is known.
    """

    effects: tuple[str, ...]
    motion: str
    campaign: Mapping[str, Any]
    cosine: float
    z: float


@dataclass(frozen=True)
class DetectionLimit:
    """The smallest size of an effect that the recorded motions would show.

    Attributes:
        effect: name of the effect.
        key: key of the knob that the size belongs to.
        size: smallest distance of the knob from its present value, SI; infinite if no plausible one
            would show. For a limit that no motion reached, the largest value that would show; 0 if
            none would.
        unit: SI unit of the size.
    """

    effect: str
    key: str
    size: float
    unit: str


@dataclass(frozen=True)
class Check:
    """The result of testing a revised model on a fresh run, as if it were the model given.

    Attributes:
        verdict: verdict on the revised model.
        effects: names of the effects that the revised model still lacks.
        gap_before: gap of the model first given, on this run: the mean of the channels' excess over
            the floor, in noise variances.
        gap_after: gap of the revised model on this run, with nothing refitted.
        scatter: standard deviation by which that gap varies by chance; where a ram sticks and
            slips, twins of the same rig differ by as much.
        discovered: where disturbances enter that the revised model still lacks
            (`Discovered.where`).
    """

    verdict: Verdict
    effects: tuple[str, ...]
    gap_before: float
    gap_after: float
    scatter: float = 0.0
    discovered: tuple[str, ...] = ()


@dataclass(frozen=True)
class Round:
    """One round of closing a gap on a rig: what was run, and what was known afterwards.

    Attributes:
        why: reason for the round, in words.
        motions: names of the motions that were run.
        recordings: recordings that were made.
        verdict: verdict from all recordings up to this round.
        effects: effects named from all recordings up to this round.
        check: check of the model revised so far; None if there was nothing to check, or if a motion
            could first settle which effect is the cause.
        discovered: disturbances discovered in all recordings up to this round.
    """

    why: str
    motions: tuple[str, ...]
    recordings: tuple[str, ...]
    verdict: Verdict
    effects: tuple[NamedEffect, ...]
    check: Check | None = None
    discovered: tuple[Discovered, ...] = ()


@dataclass
class GapResult:
    """What the workflow found.

    Attributes:
        verdict: adequate, missing_effect, unknown_effect or inconclusive.
        reasons: reasons for the verdict, in words.
        effects: effects that were named, in the order in which they were found.
        refitted: nuisances with their intervals, whether or not the model written has these values.
        channels: gap of each channel on the held-out recordings; empty if one is not finite.
        gap_before: mean of the channels' excess over the floor with the model as given, in noise
            variances; NaN if it is not finite or was not measured.
        gap_after: the same with the model as written.
        explained: part of the excess over the floor that the named effects take away in the
            recordings fitted to; NaN if none is named.
        where: disturbances that would explain what the refit of the nuisances leaves, by falling
            share.
        rest: disturbances that would explain what is left after all named effects were added;
            `where` if none is named.
        discovered: disturbances that no catalogue holds, in the order in which they were found.
        accounted: part of the excess over the floor that effects and discovered disturbances take
            away together in the recordings fitted to; NaN if there is neither.
        limits: for each effect the smallest size that the recorded motions would show.
        experiments: experiments that would settle which effects are the causes.
        free_runs: short free simulations, for the eye.
        values: values of all parameters in the model written.
        names: names of the effects that are switched on in the model written.
        as_given: whether the model written is the one given, without the values of `refitted`,
            because nothing was fitted or the fit would predict worse.
        identification: sources and content hashes of the recordings fitted to.
        holdout: sources and content hashes of the held-out recordings.
        seconds: lengths of the recordings fitted to and of those held out, s.
        rounds: rounds of closing the gap on a rig; empty if the recordings were given.
        ended_by: what ended the rounds early, such as a trip of the rig; empty if nothing did.
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
    discovered: list[Discovered] = field(default_factory=list)
    accounted: float = float("nan")
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
    def gap_scatter(self) -> float:
        """Return the standard deviation by which `gap_after` varies by chance, in noise variances.

        It is the mean of the channels' scatter, as if they all scattered together: a break-away
        that is predicted too late is wrong in all of them. It is NaN if no gap was measured.
        """
        scatters = [channel.scatter for channel in self.channels]
        return sum(scatters) / len(scatters) if scatters else float("nan")

    @property
    def written(self) -> Written:
        """Return which model is written."""
        if self.as_given:
            return "as given"
        if self.effects:
            return "with effects"
        return "with discovered" if any(d.in_model for d in self.discovered) else "refitted"
