"""A setpoint that is made of others, one after the other, without a jump where they meet."""

from dataclasses import dataclass
from math import inf

import numpy as np

from ..position_loop import raised_cosine_share
from .held import ROUNDING_S
from .protocol import TICK_S, Quantity, Samples, Setpoint, SetpointChecks, Times

RESOLUTION_M = 3e-5
"""A jump in m that no encoder of this rig shows: one of its counts (section 2.1)."""


@dataclass(frozen=True)
class Stretch:
    """A setpoint that lasts for some time, as a part of a `Sequence`.

    Attributes:
        setpoint: the setpoint, whose own time begins with the stretch, after its blend.
        duration_s: how long it lasts, s, the blend not included.
        name: its name; empty if it has none.
        blend_s: time in s in which the ram is first brought from the end of the stretch before to
            the begin of this one, along a raised cosine; 0 for no such move.
    """

    setpoint: Setpoint
    duration_s: float
    name: str = ""
    blend_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Return the time in s that the stretch takes, its blend included."""
        return self.blend_s + self.duration_s


@dataclass(frozen=True)
class Sequence:
    """Setpoints of one quantity, one after the other; the last one goes on at the end.

    Where two stretches meet the setpoint must not jump by more than both move in a tick, or by a
    count of the encoder; else the later one needs a blend. A kink is allowed, as at the begin of
    any motion.

    Raises:
        SetpointError: there is no stretch, they differ in quantity, a time is below 0 or a stretch
            lasts less than a tick, or the setpoint jumps where two of them meet.
    """

    stretches: tuple[Stretch, ...]

    def __post_init__(self) -> None:
        checks = SetpointChecks(self) if self.stretches else None
        if checks is None:
            raise ValueError("a sequence needs at least one stretch")
        with checks:
            for index, each in enumerate(self.stretches):
                where = f"stretches[{index}]"
                same = each.setpoint.quantity == self.quantity
                remedy = "give all in metres (closed loop) or all in volts (open loop)"
                checks.require(same, where, "is of another quantity", remedy, each.name or index)
                lasts = TICK_S <= each.duration_s < inf and 0.0 <= each.blend_s < inf
                limit, remedy = "lasts less than a tick, or for ever", "give times in s"
                checks.require(lasts, where, limit, remedy, each.total_s)
            checks.finish()
            for index, jump in self.jumps():
                limit = f"begins {jump:+.4g} {checks.unit} from where the one before ends"
                remedy = (
                    "give it `blend: 2 s`, or levels and phases with which it begins there"
                    if self.quantity == "position"
                    else "give it levels and phases with which it begins there"
                )
                checks.require(False, f"stretches[{index}]", limit, remedy, _name(self, index))

    @property
    def quantity(self) -> Quantity:
        """Return the quantity of all stretches."""
        return self.stretches[0].setpoint.quantity

    @property
    def duration_s(self) -> float:
        """Return the time in s that all stretches take together."""
        return float(sum(each.total_s for each in self.stretches))

    @property
    def starts_s(self) -> tuple[float, ...]:
        """Return the time in s at which each stretch begins, its blend included."""
        ends = np.cumsum([each.total_s for each in self.stretches])
        return (0.0, *(float(end) for end in ends[:-1]))

    def jumps(self) -> list[tuple[int, float]]:
        """Return (index of a stretch, its jump in m or V) where the setpoint jumps without a blend.

        A jump of a setpoint that itself jumps, as steps do, counts like any other.
        """
        found = []
        for index in range(1, len(self.stretches)):
            before, here = self.stretches[index - 1], self.stretches[index]
            if here.blend_s > 0.0:
                continue
            jump = _value(here.setpoint, 0.0) - _value(before.setpoint, before.duration_s)
            rates = (before.setpoint.peak_rate(before.duration_s), here.setpoint.peak_rate(TICK_S))
            allowed = RESOLUTION_M + TICK_S * sum(rate for rate in rates if rate < inf)
            if abs(jump) > allowed:
                found.append((index, jump))
        return found

    def window_s(self, name: str) -> tuple[float, float] | None:
        """Return (begin, end) in s of the stretches with a name, blends left out; None if none.

        Of several stretches with this name, as in a loop, it is from the first one's begin to the
        last one's end.
        """
        found = [
            (start + each.blend_s, start + each.total_s)
            for start, each in zip(self.starts_s, self.stretches, strict=True)
            if each.name == name
        ]
        return (found[0][0], found[-1][1]) if found else None

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64)
        starts = np.array(self.starts_s)
        index = np.clip(np.searchsorted(starts, time + ROUNDING_S, side="right") - 1, 0, None)
        values = np.empty(time.shape)
        for number, each in enumerate(self.stretches):
            here = index == number
            if not here.any():
                continue
            local = time[here] - starts[number] - each.blend_s
            within = each.setpoint.sample(np.maximum(local, 0.0))
            if each.blend_s > 0.0 and number > 0:
                blends = local < -ROUNDING_S
                before = self.stretches[number - 1]
                begin = _value(before.setpoint, before.duration_s)
                share = raised_cosine_share(1.0 + local / each.blend_s)
                moved = begin + (_value(each.setpoint, 0.0) - begin) * share
                within = np.where(blends, moved, within)
            values[here] = within
        return values

    def peak_rate(self, duration_s: float) -> float:
        """Return an upper bound of |d setpoint / dt| in m/s or V/s over [0, duration_s].

        It is inf if the setpoint jumps within that time.
        """
        rates = [0.0]
        for number, (start, each) in enumerate(zip(self.starts_s, self.stretches, strict=True)):
            left = duration_s - start
            if left <= 0.0 and number:
                break
            if each.blend_s > 0.0 and number:
                before = self.stretches[number - 1]
                way = _value(each.setpoint, 0.0) - _value(before.setpoint, before.duration_s)
                # The steepest place of a raised cosine has pi / 2 times its mean slope.
                rates.append(0.5 * np.pi * abs(way) / each.blend_s)
            lasts = min(each.duration_s, max(left - each.blend_s, 0.0))
            is_last = number == len(self.stretches) - 1
            # A jump at the very end of a stretch is the next one's to have, which begins there.
            inside = lasts if is_last else max(lasts - 0.5 * TICK_S, 0.0)
            rates.append(each.setpoint.peak_rate(inside))
        return float(max(rates))


def _value(setpoint: Setpoint, time_s: float) -> float:
    return float(setpoint.sample(np.array([time_s]))[0])


def _name(sequence: Sequence, index: int) -> object:
    return sequence.stretches[index].name or f"segment {index + 1}"
