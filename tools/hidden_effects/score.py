"""Scores an answer of the gap workflow by comparing it with the effects that were hidden."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import isfinite, pi, tau
from re import sub
from typing import Any, Final

from tools.hidden_effects.drawn_trials import Envelope

VERDICTS: Final = ("adequate", "missing_effect", "unknown_effect", "inconclusive")
OUTCOMES: Final = (
    "right",
    "right and more",
    "half",
    "wrong",
    "unknown",
    "missed",
    "inconclusive",
    "failed",
)
"""How an answer compares with what was hidden. A set is a named effect with those effects that the
answer calls indistinguishable from it.

- `right`: each hidden effect is in a set of its own, and every set holds a hidden effect. Where
  none can be named (none is hidden or shows, or it is off the menu), the verdict says that.
- `right and more`: each hidden effect is in a set of its own; another set holds no hidden effect.
- `half`: only one of two hidden effects is in a set.
- `wrong`: no set holds a hidden effect, or a set has more than `LARGEST_SET` names; or the verdict
  is `missing_effect` without a set, or where no effect can be named.
- `unknown`, `inconclusive`: the answer has this verdict where another one would be right.
- `missed`: the answer is adequate, although something is hidden.
- `failed`: there is no answer.
"""
MOST_ALTERNATIVES: Final = 2
"""Only so many of what a discovery could also be are looked at."""
LARGEST_SET: Final = 3
"""A set with more names than this says too little to count."""
VISIBLE_GAP: Final = 0.05
"""Shrinkage is computed only for held-out excesses from this on, in noise variances."""


@dataclass(frozen=True)
class Estimate:
    """The estimate of one parameter of a hidden effect that the answer names.

    Attributes:
        effect, parameter: names of the effect and of its parameter.
        truth, value: true and estimated value, SI. A true phase is given with those whole turns
            that bring it nearest to the estimate.
        interval: lower and upper end of the 95 % interval; None where the answer has none.
        inside: whether the true value lies in the interval; None without an interval.
    """

    effect: str
    parameter: str
    truth: float
    value: float
    interval: tuple[float, float] | None
    inside: bool | None


@dataclass(frozen=True)
class Discovery:
    """What the answer discovered beside the catalogue, compared with what is hidden off the menu.

    Attributes:
        said: "SHAPE in EQUATION of QUANTITY", as in the answer.
        placed: whether equation and quantity are among those that are right.
        shaped: whether the shape's name is right too.
        among: whether it, or one of the at most two that it could also be, is placed right.
    """

    said: str
    placed: bool
    shaped: bool
    among: bool


@dataclass(frozen=True)
class Score:
    """The score of one answer.

    Attributes:
        outcome: one of `OUTCOMES`.
        verdict: the verdict of the answer; "" if the workflow failed.
        sets: for each effect that the answer names, its name followed by the names of the effects
            that the answer calls indistinguishable from it.
        false_names: the first name of each set that holds no hidden effect of the catalogue.
        estimates: one for each parameter with an estimate of an effect that is both hidden and
            named (indistinguishable effects do not count as named); none of one in another form.
        gap: held-out excess in noise variances, before and after the effects were fitted; None
            where the answer has none, or one that is not finite.
        why: why the workflow failed; "" if it did not.
        forms: each effect that the answer names, with the form that it gives: "catalogue",
            "corrected", or "" if it gives none.
        discovered: each discovery of the answer.
    """

    outcome: str
    verdict: str
    sets: tuple[tuple[str, ...], ...] = ()
    false_names: tuple[str, ...] = ()
    estimates: tuple[Estimate, ...] = ()
    gap: tuple[float, float] | None = None
    why: str = ""
    forms: tuple[tuple[str, str], ...] = ()
    discovered: tuple[Discovery, ...] = ()

    @property
    def placed(self) -> bool:
        """Whether a discovery is placed right."""
        return any(each.placed for each in self.discovered)

    @property
    def shaped(self) -> bool:
        """Whether a discovery is placed right and its shape is named right."""
        return any(each.shaped for each in self.discovered)

    @property
    def shrinkage(self) -> float | None:
        """The share of the held-out excess that is gone; None if `gap` is None or was small.

        An excess before the fit below `VISIBLE_GAP` is small. An excess after it that is below 0
        counts as 0; the share is negative if the excess grew.
        """
        if self.gap is None or self.gap[0] < VISIBLE_GAP:
            return None
        return 1.0 - max(self.gap[1], 0.0) / self.gap[0]


def failed(why: str) -> Score:
    """Return the score of a workflow that gave no answer, for the reason `why`."""
    return Score("failed", "", why=why)


def scored(envelope: Envelope, answer: Mapping[str, Any]) -> Score:
    """Return the score of an answer, compared with what was hidden.

    An answer whose verdict is not one of `VERDICTS` has failed.

    Args:
        envelope: what was hidden.
        answer: the object that `rig gap --json` prints. A parameter in it is a number, or an object
            with `value` and with `interval` (two numbers), `low` and `high`, or `lower` and
            `upper`.
    """
    verdict = answer.get("verdict")
    if verdict not in VERDICTS:
        return failed(f"verdict {verdict!r} is not one of {', '.join(VERDICTS)}")
    named = answer.get("effects") or []
    sets = tuple((entry["name"], *(entry.get("indistinguishable_from") or ())) for entry in named)
    hidden = tuple(envelope.effects)
    false = tuple(names[0] for names in sets if not set(names) & set(hidden))
    return Score(
        _outcome(envelope, verdict, sets, false),
        verdict,
        sets,
        false,
        tuple(_estimates(envelope, named)),
        _gap(answer),
        forms=tuple((entry["name"], entry.get("form") or "") for entry in named),
        discovered=tuple(_discovery(envelope, entry) for entry in answer.get("discovered") or ()),
    )


def _discovery(envelope: Envelope, entry: Mapping[str, Any]) -> Discovery:
    """Return a discovery, compared with the places that the envelope says are right."""
    places = [place for of_effect in envelope.places.values() for place in of_effect]
    where = {
        _plain(f"{equation} of {quantity}"): place
        for place in places
        for equation in place["equations"]
        for quantity in place["of"]
    }
    also = [str(text).partition(" in ")[2] for text in entry.get("could_also_be") or ()]
    told = f"{entry['equation']} of {entry.get('of') or ''}"
    place = where.get(_plain(told))
    return Discovery(
        f"{entry['name']} in {told}".removesuffix(" of "),
        place is not None,
        place is not None and entry["name"] in place["shapes"],
        any(_plain(text) in where for text in (told, *also[:MOST_ALTERNATIVES])),
    )


def _plain(text: str) -> str:
    """Return a place in words, without the units that names of channels end with."""
    words = " ".join(text.lower().replace("_", " ").split())
    return sub(r"\b(position|pressure [12]|spool|command) (m|pa|v)\b", r"\1", words).removesuffix(
        " of"
    )


def _outcome(
    envelope: Envelope, verdict: str, sets: Sequence[Sequence[str]], false: Sequence[str]
) -> str:
    hidden = tuple(envelope.effects)
    if envelope.kind == "off_menu":
        return _among(verdict, {"unknown_effect": "right", "adequate": "missed"})
    if not hidden:
        return _among(verdict, {"adequate": "right", "unknown_effect": "unknown"})
    if envelope.kind == "unexcited" and not sets:
        return "unknown" if verdict == "unknown_effect" else "right"
    if not sets:
        return _among(verdict, {"adequate": "missed", "unknown_effect": "unknown"})
    if any(len(names) > LARGEST_SET for names in sets):
        return "wrong"
    covered = _covered(hidden, sets)
    if covered == len(hidden):
        return "right and more" if false else "right"
    return "half" if covered else "wrong"


def _among(verdict: str, outcomes: Mapping[str, str]) -> str:
    return {"missing_effect": "wrong", "inconclusive": "inconclusive", **outcomes}[verdict]


def _covered(hidden: Sequence[str], sets: Sequence[Sequence[str]]) -> int:
    """Return how many hidden effects can be assigned to sets that hold them, one set for each."""
    slots = [*sets, *[()] * len(hidden)]
    return max(
        sum(name in names for name, names in zip(hidden, chosen, strict=True))
        for chosen in permutations(slots, len(hidden))
    )


def _estimates(envelope: Envelope, named: Sequence[Mapping[str, Any]]) -> list[Estimate]:
    found = []
    for entry in named:
        if entry["name"] in envelope.forms:
            continue  # A parameter of one formula has no true value in another.
        truth = envelope.effects.get(entry["name"], {})
        answered = entry.get("parameters") or {}
        for parameter in truth.keys() & answered.keys():
            value, interval = _number(answered[parameter])
            if value is None:
                continue
            true = float(truth[parameter])
            if parameter == "phase":
                true = value + (true - value + pi) % tau - pi
            inside = None if interval is None else interval[0] <= true <= interval[1]
            found.append(Estimate(entry["name"], parameter, true, value, interval, inside))
    return sorted(found, key=lambda estimate: (estimate.effect, estimate.parameter))


def _number(answered: Any) -> tuple[float | None, tuple[float, float] | None]:
    if isinstance(answered, (int, float)):
        return float(answered), None
    if not isinstance(answered, Mapping) or answered.get("value") is None:
        return None, None
    value = float(answered["value"])
    written = (
        answered.get("interval"),
        (answered.get("low"), answered.get("high")),
        (answered.get("lower"), answered.get("upper")),
    )
    for ends in written:
        if ends and len(ends) == 2 and None not in ends:
            low, high = sorted(map(float, ends))
            return value, (low, high)
    return value, None


def _gap(answer: Mapping[str, Any]) -> tuple[float, float] | None:
    gap = answer.get("gap") or {}
    before, after = gap.get("before"), gap.get("after")
    if before is None or after is None or not isfinite(before) or not isfinite(after):
        return None
    return float(before), float(after)
