"""The page as a whole: how to read it, the outcome in short, every table, and the reasons."""

from collections.abc import Sequence
from typing import Final

from .chapters import (
    SECTION_7_1_WORDS,
    SECTION_7_2_WORDS,
    section_3_2,
    section_5,
    section_7,
)
from .leak_tables import innovation_change, residual_change
from .markdown import figure, table
from .score import score
from .trials import Trials, run_trials
from .validation import Measured
from .why import euler_section, hidden_section, levels_section, runaway_section

_CAMPAIGNS: Final = (
    ("open_loop_5_1", "thesis-6"),
    ("closed_loop_sine_5_2_1", "thesis-6"),
    ("closed_loop_pseudorandom_5_2_2", "thesis-6"),
    ("simulation_7_1", "thesis-7"),
    ("loaded_7_2", "thesis-7"),
)


def page(measured: Measured | None) -> str:
    """Return the page as Markdown; section 3.2 beside measured recordings too, if there are any."""
    open_loop, sine, pseudorandom, simulation, loaded = trials = [
        run_trials(*campaign) for campaign in _CAMPAIGNS
    ]
    sections = [
        _HEAD,
        _in_short(trials),
        section_3_2(measured),
        section_5("Table 5.1: open loop", open_loop, "5.1"),
        section_5("Table 5.2: closed loop, sine", sine, "5.2"),
        section_5("Table 5.3: closed loop, pseudorandom", pseudorandom, "5.3"),
        section_7("Section 7.1: the thesis's simulations", simulation, _FIGURES_7_1, SECTION_7_1_WORDS),
        section_7("Tables 7.1 to 7.3: against a spring", loaded, _TABLES_7_2, SECTION_7_2_WORDS),
        "## Why",
        levels_section(),
        euler_section([open_loop, sine]),
        hidden_section([open_loop, sine]),
        runaway_section(loaded),
    ]
    return "\n\n".join(sections) + "\n"


_FIGURES_7_1: Final = {
    "external_leakage_1": "Figure 7.13: leaks at chamber 1",
    "external_leakage_2": "Figure 7.14: leaks at chamber 2",
    "internal_leakage": "Figure 7.15: internal leaks",
}
_TABLES_7_2: Final = {
    "external_leakage_1": "Table 7.1: leaks at chamber 1",
    "external_leakage_2": "Table 7.2: leaks at chamber 2",
    "internal_leakage": "Table 7.3: internal leaks",
}

_HEAD: Final = """\
# The thesis's tables, run again

Written by `python -m tools.thesis_tables`; do not edit. It runs the thesis's tests, as the shipped campaigns have them,
on the simulated rig, and sets what the thesis prints beside what comes out. Figures are computed but where they are called
*printed*, and nothing is tuned towards those. The same seeds give the same page.

- **MAE**: moving average of the absolute error over 4000 samples (section 4.4, chapter 8); its mean over all windows that
  lie wholly before, or wholly after, the leak's opening. *Before → after*; a single figure is a healthy run's.
- **Innovation**, z - H x(-): the error of the prediction. **A posteriori**, z - H x(+): what eq. 4.24 defines as
  the residual, after the measurement has corrected the estimate.
- **Encoder trusted**: the thesis's filter with one figure changed. The printed variance of the position in R is 1e-4, with
  the unit m. It enters as m², a standard deviation of 1 cm; here it is read as a standard deviation of 1e-4 m.
- **Thesis's pattern**: one chamber's average above its threshold is an external leak there, both are an internal one.
  Thresholds come from the campaign's healthy test of the same motion, at one false alarm a day. **Product's detector**: the default of `rig run`,
  with its own filter. Right verdicts are **bold**.
- **By the meter**: flow and coefficient (eqs. 5.3 to 5.7) as the flow meters of the rig read them, fixed error and lag included;
  mean ± standard deviation over the samples. **Truth**: mean flow from 2 s after the leak on, as the simulation knows it."""


def _in_short(trials: Sequence[Trials]) -> str:
    head = ["campaign", "leaks", "pattern: named rightly", "fault held before the leak",
            "healthy tests it alarms in", "product: named rightly", "true flow in its interval",
            "healthy tests it alarms in"]  # fmt: skip
    rows = []
    for campaign in trials:
        counts = score(campaign.trials)
        rows.append([
            f"`{campaign.campaign.name}`, `{campaign.filter_name}`",
            *(str(n) for n in (counts.leaks, counts.pattern_right, counts.pattern_early)),
            f"{counts.pattern_alarms} of {counts.healthy}",
            str(counts.product_right), f"{counts.covered} of {counts.product_right}",
            f"{counts.product_alarms} of {counts.healthy}",
        ])  # fmt: skip
    return "\n\n".join(["## In short", table(head, rows), _general(trials[0])])


def _general(open_loop: Trials) -> str:
    healthy = open_loop.healthy()
    innovation, residual = (
        " and ".join(figure((of(healthy, i).before or 0.0) / 1e6) for i in range(2))
        for of in (innovation_change, residual_change)
    )
    return f"""\
Where and why the computed figures differ from the printed ones:

1. *A posteriori or innovation.* With the printed Q and R the filter follows the measured pressures so closely that little
   of them is left after the correction: in the healthy open loop {residual} (1e6 Pa, chambers 1 and 2), against a printed level near 0.1.
   The innovations, {innovation}, are of the printed order. The printed tables behave like innovations, so that is what the pattern here judges.
2. *What the filter cannot tell from motion.* An internal leak moves oil as a faster ram would, and the filter
   believes in the faster ram. Printed, both averages rise; computed, neither does, with either reading of R. A simulation
   lacks whatever of the real rig's behaviour the thesis's model did not hold, and it must have been that which showed.
3. *The position estimate leaves the stroke.* A leak pulls at the pressures, which the filter takes at their word, and not at the encoder,
   which it trusts to 1 cm. Once it has the piston beyond the end of a chamber its equations have no oil there, and averages
   over such samples compare nothing. Where the row *outside the stroke* is not near zero, read the row *encoder trusted* instead.
4. *Forward Euler* at 1 ms neither holds the oil column nor lets the friction settle. That makes most of the healthy level of the six-state filter.
5. *The seven-state filter runs away* as printed, healthy or not, on the loaded rig and in the thesis's own simulations. It is shown as it is.
6. *What this rig differs in.* The simulated rig has friction that creeps before it slips, a spool null bias, a softer oil, unequal friction
   extending and retracting, a supply that droops, and meters with a fixed error. The thesis's rig had faults of its own, which nobody wrote down.

With the encoder trusted an external leak raises both chambers' averages, in proportion to the leak but to much the same extent: the leak is seen, its
place is not. The pattern that isolates the leak in the thesis is in this simulation an accident of the tuning, where it appears at all."""
