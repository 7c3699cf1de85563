"""Writes the tables that explain why the thesis's filters behave as they do."""

from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np

from estimator.filters.thesis import THESIS7_MEASUREMENT_NOISE

from .causes import (
    MOTIONS,
    RIGS,
    VELOCITY,
    Stretch,
    chatter,
    empty_chamber,
    euler_error,
    healthy_level,
    hidden_leak,
    noise_ranges,
    oil_column,
    stretches,
)
from .leak_tables import LEVELS
from .markdown import NOTHING, arrow, figure, fixed, table
from .measures import rise
from .trials import Trials

_LENGTH_S: Final = 10.0
_POSITIONS: Final = (0.02, 0.1, 0.3)
"""Ram positions, m: near an end, between, and about mid stroke."""


def levels_table() -> str:
    """Return a table of the filters' innovations on healthy rigs, with one row for each rig.

    The columns are the thesis's filters in all `MOTIONS`, and the product filter in the first and
    the last of them. The rigs are ever more like the model. The last row has the error of one
    forward-Euler step.
    """
    first, last = MOTIONS[0][0], MOTIONS[-1][0]
    head = ["mean absolute innovation, chamber 1 / 2 (1e5 Pa)"]
    head += [f"{name}, {_section(campaign)}" for campaign, name in MOTIONS]
    head += [f"product, {_section(first)}", f"product, {_section(last)}"]
    rows = []
    for rig, noisy, label in RIGS:
        levels = [healthy_level(campaign, name, rig, noisy) for campaign, name in MOTIONS]
        thesis = [_pair(level.thesis) for level in levels]
        rows.append([label, *thesis, _pair(levels[0].product), _pair(levels[-1].product)])
    step = [_pair(euler_error("thesis")), *[NOTHING] * (len(head) - 2)]
    rows.append(["one forward-Euler step from that rig's true state, no filter", *step])
    return table(head, rows)


def oil_table(trials: Trials) -> str:
    """Return a table of the oil column's resonance and growth under forward Euler, by position."""
    columns = [oil_column(trials.campaign.model.parameters, x) for x in _POSITIONS]
    return table(
        ["ram position", *(f"{c.position:g} m" for c in columns)],
        [
            ["resonance of the oil column (rad/s)", *(f"{c.resonance:.0f}" for c in columns)],
            ["largest eigenvalue of A (eq. 4.19)", *(fixed(c.growth, 2) for c in columns)],
        ],
    )


def friction_table(trials: Sequence[Trials], speed: float) -> str:
    """Return a table of velocity reversals in the six-state filter, and innovations by speed.

    It has a row for the healthy sine of each campaign. Innovations are taken where the true speed
    is below and above `speed` (m/s).
    """
    named = f"{fixed(speed, 2)} m/s"
    head = ["`thesis-6`, healthy", "true reversals a second", "estimated",
            f"innovation below {named}, chamber 1 / 2 (1e5 Pa)", f"above {named}"]  # fmt: skip
    rows = []
    for campaign in trials:
        found = chatter(campaign.healthy(), speed)
        reversals = [figure(found.true_reversals), figure(found.estimated_reversals)]
        name = f"section {_section(campaign.campaign.name)}"
        rows.append([name, *reversals, _pair(found.slow), _pair(found.fast)])
    return table(head, rows)


def noise_table(trials: Sequence[Trials]) -> str:
    """Return a table of the range of averages after a leak of chamber 1 as sensor noise varies.

    It has a row for each campaign and level of leak, each with the ranges of `noise_ranges`.
    """
    head = ["MAE after the leak (1e6 Pa)", "as printed: chamber 1", "chamber 2",
            "encoder trusted: chamber 1", "chamber 2"]  # fmt: skip
    rows = []
    for campaign in trials:
        leaks = campaign.leaks("external_leakage_1")
        for level, trial in zip(LEVELS[len(leaks)], leaks, strict=True):
            averages = np.hstack(noise_ranges(campaign, trial)) / 1e6
            ends = zip(averages.min(axis=0), averages.max(axis=0), strict=True)
            name = f"section {_section(campaign.campaign.name)}, chamber 1, {level}"
            rows.append([name, *(f"{figure(low)} to {figure(high)}" for low, high in ends)])
    return table(head, rows)


def hidden_table(trials: Sequence[Trials]) -> str:
    """Return a table of the velocity error that an internal leak causes in the six-state filter.

    It has a row for each campaign and level of leak.
    """
    head = ["internal leak", "velocity error, as printed (mm/s)", "grows by",
            "encoder trusted (mm/s)", "grows by", "leak / piston area (mm/s)"]  # fmt: skip
    rows = []
    for campaign in trials:
        leaks = campaign.leaks("internal_leakage")
        for level, trial in zip(LEVELS[len(leaks)], leaks, strict=True):
            cells = [f"section {_section(campaign.campaign.name)}, {level}"]
            for states in (trial.thesis.run.states, trial.trusted.states):
                hidden = hidden_leak(trial, states[:, VELOCITY])
                cells += [arrow(hidden.error, 1e-3), figure(rise(hidden.error) / 1e-3)]
            rows.append([*cells, figure(hidden.leak / 1e-3)])
    return table(head, rows)


def runaway_table(trials: Trials) -> str:
    """Return a table of the seven-state filter's errors over time, on a healthy rig in a sine.

    It has a row for each 10 s, for the filter as printed and for the one that trusts the encoder.
    """
    trial = trials.healthy()
    printed = stretches(trial, trial.thesis.run.states, trial.thesis.run.outputs, _LENGTH_S)
    trusted = stretches(trial, trial.trusted.states, trial.trusted.outputs, _LENGTH_S)
    head = ["time (s)", "mean (1e5 Pa)", "median", "largest", "position error (mm)",
            "position estimate (m)", "encoder trusted: mean (1e5 Pa)", "largest",
            "position estimate (m)"]  # fmt: skip
    rows = [
        [
            f"{p.start_s:g} to {p.end_s:g}",
            *(figure(value / 1e5) for value in (p.mean, p.median, p.largest)),
            figure(p.position_error / 1e-3),
            _range(p),
            *(figure(value / 1e5) for value in (t.mean, t.largest)),
            _range(t),
        ]
        for p, t in zip(printed, trusted, strict=True)
    ]
    return table(head, rows)


def runaway_figures(trials: Trials) -> dict[str, str]:
    """Return the figures that the page's text beside `runaway_table` uses, by name, as text.

    They are the ends of the measured position, the positions at which a chamber is empty (all m),
    and the standard deviations that the filter assumes of pressure (kPa) and position (cm).
    """
    trial = trials.healthy()
    position, pressure = (sqrt(variance) for variance in THESIS7_MEASUREMENT_NOISE[:2])
    empty_1, empty_2 = empty_chamber(trial.model.parameters)
    return {
        "lowest": fixed(trial.recording["position_m"].min(), 3),
        "highest": fixed(trial.recording["position_m"].max(), 3),
        "pressure_sigma": figure(pressure / 1e3),
        "position_sigma": figure(position / 1e-2, 1),
        "empty_1": fixed(empty_1, 3),
        "empty_2": fixed(empty_2, 3),
    }


def _section(campaign: str) -> str:
    """Return the section that a shipped campaign is named after, such as 5.1 of `open_loop_5_1`."""
    return ".".join(part for part in campaign.split("_") if part.isdigit())


def _pair(values: tuple[float, float]) -> str:
    return " / ".join(figure(value / 1e5) for value in values)


def _range(stretch: Stretch) -> str:
    return f"{fixed(stretch.lowest, 2)} to {fixed(stretch.highest, 2)}"
