"""What the model says of the controls of tests: margins of the loop, and the error to expect.

Margins tell of gain, integral and deadband only. What a feedforward does wrong shows in the motion
of the reduced rig (`following.expected_motion`) alone, so that this is computed too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Final

from control import ControlSettings
from faults import Campaign, CampaignTest
from rig.configuration.reading import show
from rig.configuration.rigs import Rig, margins_by_model, margins_in_words, remedy_of_margins
from rig.plant import Model

from .following import expected_motion
from .loop_of_test import control_of, gain_for, motion_key

_NOTABLE_M: Final = 1e-3
"""Error in m by which a control must be worse before that is reported: the reduced rig foresees the
error of the simulated one to a millimetre or two."""
_TWICE: Final = 1.0
"""Share of the other control's error by which an order must be worse to be refused: twice as large
is no choice between two controls any more, but a mistake such as a decimal point."""
_TENTH: Final = 0.1
"""Share of the gain's error by which a section `control` must be worse to be warned of: the reduced
rig foresees errors within a tenth."""
_SHORTEST_S: Final = 0.5
"""Time in s that a control holds from which its error is looked at: so long, the offset that makes
a change free of a bump still fades (docs/tracking.md)."""
_BEYOND: Final = 0.75
"""Share of the other control's error by which a ram may go beyond the ends of its motion. At 50 V/m
an integral of 1 s without feedforward goes beyond the ends of a sine of 0.1 Hz by 0.47 of the
gain's error, and yet follows better; a feedforward of ten times the right size goes beyond those of
a sine of 150 mm at 0.5 Hz by 0.96, where its greatest error, of a ram that swings with the valve
fully open, is no larger than the gain's."""


@dataclass(frozen=True)
class Expected:
    """What the reduced rig expects of a ram under a control.

    Attributes:
        worst: greatest distance from the setpoint, m.
        beyond: greatest distance by which the ram goes beyond the ends of its motion, m.
    """

    worst: float
    beyond: float

    def __str__(self) -> str:
        """Return the greatest error in words, with what lies beyond the ends if it is notable."""
        text = f"{1e3 * self.worst:.3g} mm"
        if self.beyond >= _NOTABLE_M:
            text += f" (up to {1e3 * self.beyond:.3g} mm beyond the ends of its motion)"
        return text


def expected_error(
    test: CampaignTest,
    settings: ControlSettings,
    gain: float,
    rig: Rig,
    assumed: Model,
    begin_s: float = 0.0,
    end_s: float = inf,
) -> Expected:
    """Return the errors to expect of a closed-loop test; the arguments are `expected_motion`'s."""
    setpoint, position = expected_motion(test, settings, gain, rig, assumed, begin_s, end_s)
    beyond = max(position.max() - setpoint.max(), setpoint.min() - position.min(), 0.0)
    return Expected(float(abs(setpoint - position).max()), float(beyond))


def is_mistaken(new: Expected, others: tuple[Expected, ...], settings: ControlSettings) -> bool:
    """Return whether an ordered control is expected to be twice as bad as each of the others.

    Args:
        new: what is expected of the control that is asked for.
        others: what is expected of the controls that could be kept instead.
        settings: the settings that are asked for, in which the gain is given.
    """
    return _is_worse(new, others, settings, _TWICE)


def unstable_controls(campaign: Campaign, rig: Rig) -> tuple[tuple[str, str], ...]:
    """Return test and warning for each control that leaves a loop too small margins by the model.

    Of tests with the same control and gain the first one alone is named. Changes of the
    control of a running test are not looked at.
    """
    found: dict[tuple[ControlSettings, float], str] = {}
    for test in campaign.tests:
        if test.setpoint.quantity == "position":
            found.setdefault((control_of(rig, test), gain_for(rig, test)), test.name)
    said = (
        (name, _too_small(settings, gain, rig, campaign.model))
        for (settings, gain), name in found.items()
    )
    return tuple((name, f"the control leaves {text}") for name, text in said if text)


def control_warnings(
    test: CampaignTest, rig: Rig, assumed: Model, known: dict[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """Return warnings of changes with too small margins, and of controls that the gain alone beats.

    Args:
        test: a test; in open loop there are none.
        rig: the rig; its plant is taken for the truth.
        assumed: the model that the loop assumes.
        known: the warnings of other tests of the campaign; those of this one are added, so that
            tests of the same setpoint, load and control are computed once.
    """
    if test.setpoint.quantity != "position":
        return ()
    same = motion_key(test) + repr(test.control_changes)
    if same not in known:
        known[same] = tuple(_control_warnings(test, rig, assumed))
    return known[same]


def _control_warnings(test: CampaignTest, rig: Rig, assumed: Model) -> Iterator[str]:
    settings, first = control_of(rig, test), gain_for(rig, test)
    changes = [(each.at_s, each.control) for each in test.control_changes]
    ends = [at_s for at_s, _ in changes] + [test.duration_s]
    text = _beaten(test, settings, first, rig, assumed, 0.0, ends[0])
    if text:
        yield f"the control {text}"
    for (at_s, control), end_s in zip(changes, ends[1:], strict=True):
        gain = control.gain or first
        for text in (
            _leaves(_too_small(control, gain, rig, assumed)),
            _beaten(test, control, gain, rig, assumed, at_s, end_s),
        ):
            if text:
                yield f"the control from {show(at_s, 's')} {text}"


def _leaves(text: str) -> str:
    return f"leaves {text}" if text else ""


def _too_small(settings: ControlSettings, gain: float, rig: Rig, assumed: Model) -> str:
    """Return in words that margins are too small, and what helps; "" if they are kept."""
    par = assumed.parameters
    found = margins_by_model(settings, gain, rig, par)
    if found.kept:
        return ""
    return (
        f"{margins_in_words(found)} by the model at {gain:g} V/m, below the 6 dB and 30 degrees "
        f"that a loop must keep; {remedy_of_margins(settings, gain, rig, par)}"
    )


def _beaten(
    test: CampaignTest,
    settings: ControlSettings,
    gain: float,
    rig: Rig,
    assumed: Model,
    begin_s: float,
    end_s: float,
) -> str:
    """Return in words that the gain alone is expected to follow better; "" if it is not."""
    if settings.is_proportional or end_s - begin_s < _SHORTEST_S:
        return ""
    with_gain = replace(settings, gain=gain)
    new = expected_error(test, with_gain, gain, rig, assumed, begin_s, end_s)
    alone = expected_error(test, ControlSettings(), gain, rig, assumed, begin_s, end_s)
    if not _is_worse(new, (alone,), with_gain, _TENTH):
        return ""
    return (
        f"is expected to let the ram be off by {new}, its gain of {gain:g} V/m alone by {alone}; "
        "look at its feedforward_gain, null and deadband, or leave the section out"
    )


def _is_worse(
    new: Expected, others: tuple[Expected, ...], settings: ControlSettings, share: float
) -> bool:
    """Return whether a control is worse than each of the others by a share of their errors.

    Null and deadband are measured on the rig and mostly unknown to the model. The error that they
    make on a rig which has none of them is therefore taken off.
    """
    measured = (abs(settings.null) + settings.deadband) / (settings.gain or inf)
    worst = max(each.worst for each in others)
    beyond = max(each.beyond for each in others)
    return new.worst - measured - worst > max(
        share * worst, _NOTABLE_M
    ) or new.beyond - measured - beyond > max(_BEYOND * worst, _NOTABLE_M)
