"""The page's last part: why the thesis's filters show what they show, in figures."""

from collections.abc import Sequence
from math import sqrt
from typing import Final

from estimator.thesis import THESIS7_MEASUREMENT_NOISE
from rig.plant.integrator import TICK

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
    oil_column,
    stretches,
)
from .leak_tables import LEVELS
from .markdown import NOTHING, arrow, figure, fixed, table
from .trials import Trials

_LENGTH_S: Final = 10.0
_POSITIONS: Final = (0.02, 0.1, 0.3)
"""Ram positions in m: near an end, between, about mid stroke."""


def _pair(values: tuple[float, float]) -> str:
    return " / ".join(figure(value / 1e5) for value in values)


def levels_section() -> str:
    """Return what the healthy level is made of: rigs that differ from the model by less and less."""
    head = ["mean absolute innovation, chamber 1 / 2 (1e5 Pa)", *(_motion(m) for m in MOTIONS)]
    head += [f"product, {_section(MOTIONS[0][0])}", f"product, {_section(MOTIONS[-1][0])}"]
    rows = []
    for rig, noisy, label in RIGS:
        levels = [healthy_level(campaign, name, rig, noisy) for campaign, name in MOTIONS]
        thesis = [_pair(level.thesis) for level in levels]
        rows.append([label, *thesis, _pair(levels[0].product), _pair(levels[-1].product)])
    step = [_pair(euler_error("thesis")), *[NOTHING] * (len(head) - 2)]
    rows.append(["one forward-Euler step from that rig's true state, no filter", *step])
    return "\n\n".join(["### What the healthy level is made of", table(head, rows), _LEVELS])


def _motion(motion: tuple[str, str]) -> str:
    return f"{motion[1]}, {_section(motion[0])}"


def _section(campaign: str) -> str:
    """Return the section a shipped campaign is named after, as `5.1` in `open_loop_5_1`."""
    return ".".join(part for part in campaign.split("_") if part.isdigit())


_LEVELS: Final = (
    "From row to row the rig loses what the filter does not know of it. The levels hardly fall; the rig with "
    "Karnopp friction, whose breakaway is sudden, even raises those of `thesis-6`. So they are not the "
    "rig's imperfections, nor the transducers' noise alone, but mostly the filter's own; the next tables "
    "say how. The product's filter stands beside it on the same recordings. A leak has to show above this "
    "level. On the thesis's rig errors of its model came on top, and yet the averages it prints for the "
    "healthy open loop are no higher: how its filter was run must differ from what is printed in "
    "more than we can tell."
)


def euler_section(trials: Sequence[Trials]) -> str:
    """Return what one forward-Euler step of a millisecond does to oil column and friction."""
    par = trials[0].campaign.model.parameters
    columns = [oil_column(par, x) for x in _POSITIONS]
    oil = table(
        ["ram position", *(f"{c.position:g} m" for c in columns)],
        [
            ["resonance of the oil column (rad/s)", *(f"{c.resonance:.0f}" for c in columns)],
            ["largest eigenvalue of A (eq. 4.19)", *(fixed(c.growth, 2) for c in columns)],
        ],
    )
    step = par.coulomb * TICK / par.moving_mass
    speed = f"{fixed(step, 2)} m/s"
    rows = []
    for campaign in trials:
        found = chatter(campaign.healthy(), step)
        rows.append([
            f"section {_section(campaign.campaign.name)}, healthy",
            figure(found.true_reversals), figure(found.estimated_reversals),
            *(_pair(level) for level in (found.slow, found.fast)),
        ])  # fmt: skip
    head = ["`thesis-6`", "true reversals a second", "estimated",
            f"innovation below {speed}, chamber 1 / 2 (1e5 Pa)", f"above {speed}"]  # fmt: skip
    return "\n\n".join(["### Forward Euler at 1 ms", oil, _OIL, table(head, rows),
                        _friction_words(speed)])  # fmt: skip


_OIL: Final = (
    "One prediction multiplies an error in the oil column by the second row; only the measured pressures pull "
    "it back, sample by sample. This is why the thesis finds 1000 Hz to be the lowest sampling frequency "
    "that works (chapter 5). The product's filter and the simulated rig step stably."
)


def _friction_words(speed: str) -> str:
    return (
        f"In one such step the slip friction alone changes the ram's velocity by {speed}, so that below "
        "about that speed the predicted friction pushes the ram through zero and back at the next step: the estimated "
        "velocity chatters, and the oil it displaces shows as innovation of both pressures. Slow motions "
        "have the higher level for it, and this, more than anything of the rig, is what a leak has to rise above."
    )


def hidden_section(trials: Sequence[Trials]) -> str:
    """Return where an internal leak goes in the six-state filter."""
    head = ["internal leak", "velocity error, as printed (mm/s)", "encoder trusted (mm/s)",
            "leak / piston area (mm/s)"]  # fmt: skip
    rows = []
    for campaign in trials:
        leaks = campaign.leaks("internal_leakage")
        for level, trial in zip(LEVELS[len(leaks)], leaks, strict=True):
            found = [
                hidden_leak(trial, states[:, VELOCITY])
                for states in (trial.thesis.run.states, trial.trusted.states)
            ]
            name = f"section {_section(campaign.campaign.name)}, {level}"
            changes = [arrow(hidden.error, 1e-3) for hidden in found]
            rows.append([name, *changes, figure(found[0].leak / 1e-3)])
    return "\n\n".join(["### Where an internal leak goes", table(head, rows), _HIDDEN])


_HIDDEN: Final = (
    "Estimated less true velocity, counted from the higher pressure to the lower, before → after. An internal "
    "leak takes from one chamber what it gives to the other, exactly as a faster ram does. The filter is "
    "free to think the ram faster (Q of velocity and position), and does, by about the leak over the "
    "piston area; the pressures then fit and no innovation is left. That is why neither reading of R shows it. "
    "On the thesis's rig both averages rose: there, the leak must have shown through something "
    "that neither this simulation nor that filter models. What, the thesis does not let us tell."
)


def runaway_section(trials: Trials) -> str:
    """Return how the seven-state filter does on a healthy loaded rig, over time."""
    trial = trials.healthy()
    first, second = empty_chamber(trial.model.parameters)
    printed = stretches(trial, trial.thesis.run.states, trial.thesis.run.outputs, _LENGTH_S)
    trusted = stretches(trial, trial.trusted.states, trial.trusted.outputs, _LENGTH_S)
    head = ["time (s)", "mean (1e5 Pa)", "median", "largest", "position error (mm)",
            "position estimate (m)", "trusted: mean (1e5 Pa)", "largest",
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
    position, pressure = (sqrt(variance) for variance in THESIS7_MEASUREMENT_NOISE[:2])
    words = (
        "Absolute innovation of pressure 1 in section 7.2's healthy sine; the ram is within "
        f"{fixed(trial.recording['position_m'].min(), 3)} to "
        f"{fixed(trial.recording['position_m'].max(), 3)} m throughout. The filter as printed "
        f"believes its pressures to {figure(pressure / 1e3)} kPa and its encoder to {figure(position / 1e-2)} cm "
        "(R; the transducers' own sigma is far above the one and below the other), and with the friction "
        "model gone from it nothing else ties the position down: pressure noise is taken for "
        f"displacement. At {fixed(first, 3)} m chamber 1 would have no volume, at {fixed(second, 3)} m chamber 2; "
        "the estimate passes through both, the bulk modulus is divided by next to nothing (eq. 2.3), and single "
        "innovations reach what the table's column *largest* says. The mean follows from these; the median does "
        "not see them. Only the position's variance in R, read as its unit says, and the same filter "
        "stays in the stroke after its start, where the printed P0 still throws it once."
    )
    return "\n\n".join(["### The seven-state filter runs away", table(head, rows), words])


def _range(stretch: Stretch) -> str:
    return f"{fixed(stretch.lowest, 2)} to {fixed(stretch.highest, 2)}"
