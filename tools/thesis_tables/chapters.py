"""The page's sections on the thesis's own tables: what is printed beside what comes out, and a word on it."""

from collections.abc import Sequence
from typing import Final

from .leak_tables import Column, columns_of, innovation_change, leak_table, trusted_change
from .markdown import NOTHING, figure, table
from .measures import LEAST_DROP, Change
from .printed import SECTION_7_1, SECTION_7_2, TABLE_5_1, TABLE_5_2, TABLE_5_3
from .score import score
from .trials import Trials
from .validation import (
    FIGURES,
    FILES,
    PRINTED,
    Comparison,
    Measured,
    compare,
    compare_with_itself,
    compare_without_drift,
    one_step_error,
    simulated_recordings,
)

EXTERNAL: Final = ("external_leakage_1", "external_leakage_2")
INTERNAL: Final = "internal_leakage"
KINDS: Final = (*EXTERNAL, INTERNAL)


def _rise(change: Change) -> float:
    return (change.after or 0.0) - (change.before or 0.0)


def _rises(column: Column, trusted: bool) -> tuple[float, float]:
    of = trusted_change if trusted else innovation_change
    return _rise(of(column.trial, 0)), _rise(of(column.trial, 1))


def pattern_sentence(columns: Sequence[Column], trusted: bool = False) -> str:
    """Say how often the averages of the innovations rise as the thesis's pattern has it (section 5.3)."""
    external, internal = [], []
    for column in columns:
        if column.trial.leak is None:
            continue
        first, second = _rises(column, trusted)
        if column.kind == INTERNAL:
            internal.append(first > 0.0 and second > 0.0)
        else:
            external.append(first > second if column.kind == EXTERNAL[0] else second > first)
    parts = []
    if external:
        parts.append(
            f"the leaking chamber's average rises more than the other's in {sum(external)} of "
            f"{len(external)} external leaks"
        )
    if internal:
        parts.append(f"both averages rise in {sum(internal)} of {len(internal)} internal leaks")
    return ", and ".join(parts)


def verdict_sentence(columns: Sequence[Column]) -> str:
    """Say how often either detector names the leak, and the product's interval holds the flow."""
    counts = score([column.trial for column in columns])
    return (
        f"Of {counts.leaks} leaks the thesis's pattern names {counts.pattern_right} "
        f"(and held a fault before the leak in {counts.pattern_early}), the product's detector "
        f"{counts.product_right}; the true flow is within its interval in {counts.covered} of these."
    )


def section_3_2(measured: Measured | None) -> str:
    """Return section 3.2: the model beside the simulated rig, and beside measured recordings if given."""
    model, simulated = simulated_recordings()
    parts = ["## Section 3.2: the model beside a healthy rig", _SECTION_3_2]
    if measured is not None:
        parts.append(_origin(measured))
    for motion, title in (
        ("sine", "### Section 3.2.1: 3 sin(2πt + 0.1) V, 10 s"),
        ("chirp", "### Section 3.2.2: 3 sin(π(1 + t/4)t) V, 40 s"),
    ):
        head = ["recorded less simulated", "printed"]
        comparisons: list[Comparison] = []
        one_step = []
        sources = [("simulated rig", simulated[motion])]
        if measured is not None:
            sources.append(("recording", measured.recordings[motion]))
        for name, recording in sources:
            head += [name, f"{name}, drift out"]
            comparisons += [compare(recording, model), compare_without_drift(recording, model)]
            one_step += [one_step_error(recording, model)] * 2
        head.append("model less itself, one count apart")
        comparisons.append(compare_with_itself(sources[-1][1], model))
        rows = [
            [name, PRINTED[motion].get(name, NOTHING), *(figure(take(c) / unit) for c in comparisons)]
            for name, unit, take in FIGURES
        ]
        for i, chamber in ((1, "pressure 1"), (2, "pressure 2")):
            steps = [figure(error[i] / 1e5) for error in one_step]
            rows.append([f"{chamber}, one sample ahead (1e5 Pa)", NOTHING, *steps, NOTHING])
        parts += [title, table(head, rows)]
    return "\n\n".join(parts)


def _origin(measured: Measured) -> str:
    files = ", ".join(
        f"`{FILES[motion]}` ({recording.content_hash()[:12]})"
        for motion, recording in measured.recordings.items()
    )
    return (
        f"*Recording*: {files}; in brackets the beginning of its content's SHA-256. Origin as stated by "
        f"whoever ran this: {measured.origin}."
    )


_SECTION_3_2: Final = (
    "The nominal model is simulated with the recorded command, from the recorded initial state on. "
    "The model of the tables has no spool null bias and no asymmetry of friction, the rigs have: a free "
    "run therefore drifts off, far beyond the printed errors. The thesis took its drift out by adjusting "
    "the friction model; here, in the columns *drift out*, the model is given the spool null bias at which "
    "it ends where the rig did. With that the position errors come to the size of the printed ones. The "
    "pressure errors do not fall by as much, and the last column says why no one should judge a model by "
    "them: stick-slip lets two runs of the very same model, started one encoder count apart, part in "
    "pressure by a good part of that. The last rows show what the model is off by one sample ahead (mean "
    "absolute innovation of the product's filter, sensor noise included). The thesis finds a bias in "
    "the spool's reading; the simulated sensor reads none, as a hydraulic null that is off does not show in it. "
    "Whether the thesis averages errors or their magnitudes it does not say; the signs of section 3.2.2 "
    "suggest errors."
)


def section_5(title: str, trials: Trials, number: str) -> str:
    """Return the table of a campaign of chapter 5: "5.1", "5.2" or "5.3"."""
    printed = {"5.1": TABLE_5_1, "5.2": TABLE_5_2, "5.3": TABLE_5_3}[number]
    columns = columns_of(trials, printed, KINDS, sine=number != "5.3")
    return "\n\n".join(
        [
            f"## {title}",
            leak_table(columns, 6),
            f"As printed, {pattern_sentence(columns)}; with the encoder trusted, "
            f"{pattern_sentence(columns, trusted=True)}. {verdict_sentence(columns)} {_WORDS[number]}",
        ]
    )


_WORDS: Final = {
    "5.1": (
        "The level depends on where in the stroke the ram works, through the volume of each chamber: the "
        "two mirrored starting positions give mirrored levels *before*, and thresholds learnt from the "
        "healthy run in between raise false alarms at either. That the smaller leak at chamber 1 gives the "
        "larger average is the position estimate leaving the stroke: where it puts the piston beyond the "
        "end of a chamber, the filter's oil has next to no volume and its pressure leaps. With the encoder "
        "trusted this is gone, and the averages grow with the leak as in the thesis, but in both chambers. "
        "Coefficients by the meters come out above those asked by the meters' fixed error, most where the "
        f"drop is small; samples below {LEAST_DROP / 1e6:g} MPa are left out. They scatter less than the "
        "printed ones, as the simulated needle valve obeys eq. 5.2 exactly."
    ),
    "5.2": (
        "The healthy level lies below that of the open loop, though the thesis's levels after a leak are above "
        "its open-loop ones: its rig's closed loop must have shown its filter errors of the model that the "
        "simulated one does not have. The leaks of either chamber carry the position estimate out of the "
        "stroke for much of the time, and what the averages then tell is mostly that."
    ),
    "5.3": (
        "Averages are not printed for this motion; the text says that with the low leak at chamber 1 most "
        "values of that chamber exceed 0.2 (1e6 Pa) after the leak and the other chamber's stay below. The "
        "healthy level is already about there: every step of the setpoint saturates the valve and shakes "
        "the filter, more than a leak does. Each test has a sequence of its own, which moves the level by "
        "as much again, as the thesis notes too."
    ),
}


def section_7(title: str, trials: Trials, tables: dict[str, str], words: str) -> str:
    """Return three tables of a campaign of chapter 7, one a kind of leak, under the headings given."""
    printed = SECTION_7_2 if trials.campaign.name.startswith("loaded") else SECTION_7_1
    parts, every = [f"## {title}"], []
    for kind, heading in tables.items():
        columns = columns_of(trials, printed, (kind,))
        every += columns
        parts += [f"### {heading}", leak_table(columns, 5)]
    parts.append(
        f"As printed, {pattern_sentence(every)}; with the encoder trusted, "
        f"{pattern_sentence(every, trusted=True)}. {verdict_sentence(every)} {words}"
    )
    return "\n\n".join(parts)


SECTION_7_1_WORDS: Final = (
    "The thesis draws these averages and prints none. Here truth and filter share every equation but "
    "friction, which the filter takes for load, and still the filter as printed runs away (below): what "
    "it shows before a leak is no better than after. With the encoder trusted both averages grow with an "
    "external leak, and fall a little with an internal one. The leaks are of the linear law, eq. 5.1, and "
    "the product's detector assumes the square-root law, so that its flow is that of another law fitted "
    "to the same oil: it need not be within the interval, which knows nothing of the law being wrong. "
    "Internal coefficients by the meter are dominated by the samples with a small drop, where the meter's "
    "fixed error is divided by next to nothing."
)

SECTION_7_2_WORDS: Final = (
    "Flows were set to the printed ones at the drop that the load leaves in the mean; the coefficients "
    "the thesis gives would pass several times as much. The seven-state filter as printed runs away on "
    "every one of these tests (below), so its averages say nothing. With the encoder trusted its healthy "
    "level comes to the order of the printed one, but the averages hardly move with the leak: "
    "in chamber 1 not at all, in chamber 2 with either external leak, and down with an internal one. The "
    "motion is small and slow: a leak is made up for by a slightly wider valve at lower chamber pressures, "
    "and the filter's load and velocity follow. This is also the motion in which the product's detector, "
    "which allows for tolerances of the valve, has least to go by."
)
