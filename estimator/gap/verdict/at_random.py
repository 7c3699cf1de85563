"""This module recognises an input that acts at random times, which no curve can show.

A command that is late by another time at each sample leaves errors whose mean is 0 and whose
squares grow with the rate of the command. So do the errors of a cause that is not random, such as a
filter or a resonance before the valve. What tells them apart is prediction: what is not random
follows from the course of the command, or lasts; what is random does neither.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Array
from estimator.gap.prediction import HUBER, Discovered, Filtered, Values

from .lexicon import LEXICON
from .unsettled import Unsettled

RANDOM_DELAY: Final = "random_delay"
"""Name of the shape in the lexicon, and of its form."""
_LITTLE: Final = 0.3
"""Part of the excess in squared error. What is random may have no more than this of what follows
from the command's course, and no more of what lasts. This bound was chosen: it is ten times what
chance gives (a correlation of a thousand samples is known to 0.03), and well below what causes that
are not random leave, which is most of it."""
_FOLDS: Final = 4
"""Number of parts of each recording; a filter of the command is judged on the parts that it was not
fitted to."""


def random_delays(
    filtered: Filtered, values: Values, left: Sequence[Unsettled]
) -> list[Discovered]:
    """Return the input that acts at random times, as a disturbance that was discovered, or nothing.

    It is that on whose rate the squared errors of the worst channel depend more than on any other
    quantity, and where they are largest when it changes fastest. Neither may more than `_LITTLE` of
    the excess in these squares be predicted by the input's course (`predicted_part`), nor may more
    of it last (`lasting_part`).

    Args:
        filtered: the records, with gains for `values`.
        values: values of all parameters, with all that is claimed.
        left: what each channel's errors have above those of twins, with these values.
    """
    plant = filtered.predictor.plant
    counted = [channel for channel in left if channel.counts]
    if not counted:
        return []
    worst = max(counted, key=lambda channel: channel.stirred)
    rates = {f"rate of {name}": index for index, name in enumerate(plant.inputs)}
    if worst.region not in rates or int(np.argmax(worst.values)) != len(worst.values) - 1:
        return []
    index = rates[worst.region]
    output = [each.channel for each in plant.outputs].index(worst.channel)
    errors, inputs = [], []
    for (innovations, _), record, blocks in zip(
        filtered.innovations(values), filtered.records, filtered.blocks, strict=True
    ):
        inside = slice(blocks[0].start, blocks[-1].stop)
        errors.append(np.clip(innovations[inside, output], -HUBER, HUBER))
        inputs.append(record.inputs[inside, index])
    length = round(plant.horizon / plant.period)
    follows = predicted_part(errors, inputs, worst.floor, length)
    lasts = lasting_part(errors, worst.floor, length)
    if max(follows, lasts) > _LITTLE:
        return []
    name, none = plant.inputs[index], np.empty(0)
    what = (
        f"{name} acts at random times: squared errors of {worst.channel} grow with the rate of "
        f"{name}, from {worst.values.min():.2g} to {worst.values[-1]:.2g} predicted variances "
        f"above the noise, and neither follow from its course ({max(follows, 0.0):.0%} of them) "
        f"nor last for {0.5 * plant.horizon * 1e3:.3g} ms ({max(lasts, 0.0):.0%}). No model can "
        "predict them"
    )
    return [
        Discovered(
            RANDOM_DELAY, name, "", "", RANDOM_DELAY, what, LEXICON[RANDOM_DELAY].parts, (),
            none, none, none, "", "", float("nan"), float("nan"), float("nan"),
            in_model=False, experiment=LEXICON[RANDOM_DELAY].experiment,
        )
    ]  # fmt: skip


def predicted_part(
    errors: Sequence[Array], inputs: Sequence[Array], floor: float, length: int
) -> float:
    """Return the part of the excess in squared error that follows from the input's course.

    A linear filter of the input's last changes is fitted, with the input, its square with the
    input's sign, the sign of its last change and a constant beside it. It is fitted to all parts of
    the recordings but one, and judged on that one (cross-validation, Stone 1974). The result is
    below 0 where it predicts worse than nothing, and 0 where there is no excess.

    Args:
        errors: float64 (n,) of each record, one-step errors in standard deviations.
        inputs: float64 (n,) of each record, the input.
        floor: mean square of the errors that a twin has.
        length: number of last changes of the input that the filter uses.
    """
    columns, folds = [], []
    for u in inputs:
        changes = np.diff(u, prepend=u[0])
        padded = np.concatenate([np.zeros(length), changes])
        course = np.lib.stride_tricks.sliding_window_view(padded, length)[1:]
        turned = np.sign(changes)
        columns.append(np.column_stack([course, u, turned, u * np.abs(u), np.ones(len(u))]))
        folds.append(np.arange(len(u)) * _FOLDS // len(u))
    x, e, fold = np.concatenate(columns), np.concatenate(list(errors)), np.concatenate(folds)
    excess = float(np.square(e).sum()) - floor * len(e)
    if excess <= 0.0:
        return 0.0
    scale = np.sqrt(np.square(x).mean(0))
    x = x / np.where(scale > 0.0, scale, 1.0)
    gained = 0.0
    for number in range(_FOLDS):
        out = fold == number
        fitted_to = x[~out]
        # A trace of a penalty, for an input whose changes follow from each other.
        matrix = fitted_to.T @ fitted_to + 1e-6 * len(e) * np.eye(x.shape[1])
        predicted = x[out] @ np.linalg.solve(matrix, fitted_to.T @ e[~out])
        gained += float(np.square(e[out]).sum() - np.square(e[out] - predicted).sum())
    return gained / excess


def lasting_part(errors: Sequence[Array], floor: float, length: int) -> float:
    """Return the part of the excess in squared error that is still there later.

    That is the largest correlation of the errors with themselves, of either sign, half of `length`
    to `length` samples apart. The valve answers one late sample of the command for less than that.
    The result is 0 where there is no excess.

    Args:
        errors: float64 (n,) of each record, one-step errors in standard deviations.
        floor: mean square of the errors that a twin has.
        length: number of samples.
    """
    excess = sum(float(np.square(e).sum()) - floor * len(e) for e in errors)
    if excess <= 0.0:
        return 0.0
    return max(
        abs(sum(float(e[:-lag] @ e[lag:]) for e in errors)) / excess
        for lag in range(max(length // 2, 1), length + 1)
    )
