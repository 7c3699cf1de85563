"""Draws the pictures of the worked example in docs/gap.md."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.oil_account import OilAccount
from estimator.leaks.replaying import filter_recording, samples_of
from rig.plant import Model
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.counted_shares import interval

from .tables import MODELS, judged, right, wrong
from .trials import Trial

Array = NDArray[np.float64]

_COLOURS: Final = {"nominal": "tab:red", "revised": "tab:green"}
_SETTLING_S: Final = 2.0
_BINS: Final = 4


def _save(figure: Figure, file: Path) -> None:
    """Write a figure as PNG; the same figure always gives the same file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110, metadata={"Software": None})


def _accounts(recording: Recording, model: Model) -> tuple[Array, Array]:
    """Return the end times (n,) in s of the accounts' blocks, and the missing oil (n, 2) in L/min.

    The two columns of the missing oil are the chambers.
    """
    account = OilAccount(model.parameters, LeakTest(1.0))
    blocks = list(account.add(samples_of(recording), filter_recording(recording, model)))
    ends = np.array([block.end_s for block in blocks])
    missing = np.array([block.missing for block in blocks]) / LITRE_PER_MINUTE
    return ends, missing


def accounts_picture(
    recording: Recording, models: Mapping[str, Model], onset_s: float, flow: float, file: Path
) -> None:
    """Draw the missing oil of both chambers over one recording, as computed with each model.

    The first 2 s are left out.

    Args:
        recording: of a rig with a leak out of chamber 1.
        models: the models by name, `nominal` or `revised`.
        onset_s: when the leak opens, s.
        flow: mean flow of the leak, L/min.
        file: PNG file to write.
    """
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    for name, model in models.items():
        ends, missing = _accounts(recording, model)
        kept = ends > _SETTLING_S
        for axes, values in zip(both, missing.T, strict=True):
            axes.plot(ends[kept], values[kept], color=_COLOURS[name], lw=1.5, marker="o", ms=3,
                      label=f"{name} model")  # fmt: skip
    for chamber, axes in enumerate(both, 1):
        true = flow if chamber == 1 else 0.0
        axes.plot([_SETTLING_S, onset_s, onset_s, recording.time_s[-1]], [0.0, 0.0, true, true],
                  color="0.3", lw=1, ls="--", label="true leak")  # fmt: skip
        axes.set(xlabel="time (s)", title=f"chamber {chamber}")
        axes.grid(alpha=0.3)
    both[0].set_ylabel("missing oil (L/min)")
    both[0].legend(fontsize=8)
    _save(figure, file)


def sizes_picture(trials: Sequence[Trial], file: Path) -> None:
    """Draw, for each model, the share of leaks named right by size, and of healthy rigs alarmed."""
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    left, rest = figure.subplots(1, 2, width_ratios=(3, 1))
    leaks = [trial for trial in trials if trial.leak is not None]
    flows = np.array([trial.flow for trial in leaks])
    edges = np.quantile(flows, np.linspace(0.0, 1.0, _BINS + 1))
    which = np.clip(np.digitize(flows, edges) - 1, 0, _BINS - 1)
    for place, model in enumerate(MODELS):
        named = np.array([right(*each) for each in judged(leaks, model)])
        for number in range(_BINS):
            chosen = which == number
            middle = float(np.exp(np.log(flows[chosen]).mean()))
            label = f"{model} model" if number == 0 else None
            _bar(left, middle * (1.0 + 0.03 * place), named[chosen], model, label)
        alarmed = np.array([wrong(*each) for each in judged(trials, model) if each[0].leak is None])
        _bar(rest, place, alarmed, model, None)
    left.set(xscale="log", xlabel="leak (L/min)", ylabel="share named right", ylim=(-0.03, 1.03),
             title="leaks that open, 18 s later")  # fmt: skip
    ticks = [0.03, 0.05, 0.1, 0.2, 0.3]
    left.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks], minor=False)
    left.minorticks_off()
    left.legend(fontsize=8)
    rest.set(ylim=(-0.03, 1.03), xlim=(-0.6, 1.6), ylabel="share alarmed", title="healthy, 30 s")
    rest.set_xticks([0, 1], labels=list(MODELS))
    for axes in (left, rest):
        axes.grid(alpha=0.3)
    _save(figure, file)


def _bar(axes: Any, at: float, flags: NDArray[np.bool_], model: str, label: str | None) -> None:
    """Draw the share of True in `flags` with its 95 % interval, at the abscissa `at`."""
    share = float(flags.mean())
    low, high = interval(int(flags.sum()), flags.size)
    axes.errorbar(at, share, [[share - low], [high - share]], color=_COLOURS[model], marker="o",
                  ms=5, capsize=3, label=label)  # fmt: skip
