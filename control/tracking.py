"""The tracking law beside the proportional one, compiled: what it adds to gain times error.

Velocity feedforward and the tones of a cyclic setpoint are prepared before a test begins
(`control.guidance`), so that a tick only adds them. The law is straight-line code over floats, or
over lanes of several rigs (`rig.lanes`), and the limit of the command is applied once, at its end.
"""

from math import cos, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import anywhere, select
from rig.plant import inner

from .loop_model import MOST_TONES
from .position_loop import proportional_command

Array = NDArray[np.float64]

TONE_NUMBERS: Final = 4
"""Numbers of a tone in `Guide.tones`: angular frequency in rad/s; real and imaginary part of the
factor by which error becomes correction in a tick; greatest correction in m."""


class ControlLaw(NamedTuple):
    """The numbers of the tracking law; with `proportional` set, the others are not used."""

    proportional: bool
    """Whether the command is that of the proportional loop alone, bit for bit."""
    null_V: float  # noqa: N815
    """Command in V at which the valve is closed."""
    deadband_V: float  # noqa: N815
    """Command in V on either side of null at which the valve begins to open."""
    width_V: float  # noqa: N815
    """Command in V about null over which the compensation of the deadband is smooth; above 0."""
    integral_rate: float
    """Integral gain in V/(m s); 0 for none."""
    integral_limit_V: float  # noqa: N815
    """Greatest magnitude of the integral part, V."""
    hold_band_m: float
    """Error in m within which the integral is held while the setpoint rests."""
    rest_s: float
    """Time in s after which the integral is held whatever the error, if the setpoint rests."""


PROPORTIONAL: Final = ControlLaw(True, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
"""The law of the thesis, section 5.2: gain times error, limited."""


class Guide(NamedTuple):
    """A test's control law with what is known of its setpoint beforehand."""

    law: ControlLaw
    """The law's numbers."""
    feedforward: Array
    """(ticks,) command in V by which a ram follows the setpoint without error; (0,) for none. A
    tick beyond its end has 0 V."""
    tones: Array
    """(n, TONE_NUMBERS), the setpoint's frequencies that are corrected; (0, TONE_NUMBERS) for
    none."""
    expected: Array = np.empty(0)
    """(ticks,) position in m where the ram should be without an integral part
    (`control.expected`); (0,) for none. In a tick beyond its end that is the setpoint."""

    def part(self, ticks: slice) -> "Guide":
        """Return the same guide with the tables of some ticks only."""
        return self._replace(feedforward=self.feedforward[ticks], expected=self.expected[ticks])


PLAIN: Final = Guide(PROPORTIONAL, np.empty(0), np.empty((0, TONE_NUMBERS)))
"""The guide of the proportional loop."""


class ControlMemory(NamedTuple):
    """What the tracking law remembers from tick to tick."""

    kept: Array
    """(3,): integral part of the command in V; setpoint of the last tick in m, NaN before; time in
    s for which the setpoint has rested."""
    learnt: Array
    """(MOST_TONES, 2): cosine and sine part of each tone's correction, m."""


def control_memory() -> ControlMemory:
    """Return the memory before the first tick."""
    memory = ControlMemory(np.zeros(3), np.zeros((MOST_TONES, 2)))
    memory.kept[1] = np.nan
    return memory


@njit(cache=True, error_model="numpy", nogil=True)
def begin_motion(follows, memory):
    """Make the memory ready for a motion that begins.

    The corrections of the last motion's tones are forgotten. The integral part is kept if the
    position loop goes on (`follows`), so that the command does not jump where one motion ends and
    the next begins; otherwise it starts from 0 again.
    """
    for i in range(MOST_TONES):
        memory.learnt[i, 0] = 0.0
        memory.learnt[i, 1] = 0.0
    memory.kept[1] = np.nan
    memory.kept[2] = 0.0
    if not follows:
        memory.kept[0] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def tracking_command(
    setpoint, position, ahead, expected, time_s, gain, limit, period, law, tones, memory
):
    """Return the valve command in V of the tracking law, within +-`limit`; called once a tick.

    With error e = setpoint - position the law is

        w = gain (e + c) + ahead + i,    u = null + w + deadband w / sqrt(w^2 + width^2),

    where c is the correction of the setpoint's tones and i the integral part. The smooth form of
    the deadband's compensation has a finite slope at null, 1 + deadband / width, so that noise of
    the encoder does not make the spool chatter. The integral part sums up what the ram lags behind
    the expected position, not behind the setpoint: the error by which a loop answers a step is no
    error of the rig. It grows only while the command is within its limit or returns there (no
    windup), never beyond its own limit, and is held while the setpoint rests and the error is
    within the band of a hold: a ram that sticks is then left alone. After a while of rest it is
    held whatever the error is: with play in valve or encoder an integral swings for ever, a
    proportional loop does not.
    A tone's correction is the part of the error at its frequency, divided by what the closed loop
    makes of a correction, and followed slowly; while the command is at its limit nothing is learnt.

    If setpoint, position, feedforward or expected position is NaN, the command is 0 V, the valve's
    null, as a ram of unknown position must not be driven, and the integral part starts again from
    0.

    In compiled code, numbers may be lanes and the memory's arrays arrays of lanes (`in_lanes`); the
    memory is then updated in all lanes, and sines are right to 1e-9.

    Args:
        setpoint: position that is asked for, m.
        position: measured position, m.
        ahead: feedforward of this tick, V.
        expected: position in m by which the integral part goes, as `Guide.expected`; the setpoint
            itself where none is known.
        time_s: time of the tick in its motion, s.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        period: period of the loop, s.
        law: `ControlLaw`; with `law.proportional` the command is that of `proportional_command`.
        tones: (n, TONE_NUMBERS), as `Guide.tones`, n at most `MOST_TONES`.
        memory: `ControlMemory`; updated.
    """
    if law.proportional:
        return proportional_command(setpoint, position, gain, limit)
    kept, learnt = memory.kept, memory.learnt
    error = setpoint - position
    # A NaN is not equal to itself.
    known = (error == error) & (ahead == ahead) & (expected == expected)
    correction = 0.0
    for i in range(tones.shape[0]):
        angle = tones[i, 0] * time_s
        correction += learnt[i, 0] * cos(angle) + learnt[i, 1] * sin(angle)
    integral = kept[0]
    wanted = gain * (error + correction) + ahead + integral
    bent = law.deadband_V * wanted / sqrt(wanted * wanted + law.width_V * law.width_V)
    free = law.null_V + wanted + bent
    command = min(max(free, -limit), limit)
    is_free = known & (command == free)
    moves = (setpoint != kept[1]) & (kept[1] == kept[1])
    rested = select(moves, 0.0, kept[2] + period)
    outside = (abs(error) > law.hold_band_m) & (rested < law.rest_s)
    behind = expected - position
    grows = known & (is_free | (behind * free < 0.0)) & (moves | outside)
    grown = integral + law.integral_rate * behind * period
    grown = min(max(grown, -law.integral_limit_V), law.integral_limit_V)
    kept[0] = select(known, select(grows, grown, integral), 0.0)
    kept[1] = setpoint
    kept[2] = select(known, rested, kept[2])
    if anywhere(is_free):
        for i in range(tones.shape[0]):
            _learn(i, error, time_s, tones, is_free, learnt)
    return select(known, command, 0.0)


@inner
def _learn(i, error, time_s, tones, where, learnt):
    """Move the correction of tone `i` towards what cancels the error at its frequency.

    Where the condition `where` does not hold, the correction stays.

    The correction is Re(a exp(jwt)), a = learnt[0] - j learnt[1]. Its step is f e exp(-jwt), whose
    mean over a period is half the error's complex amplitude times the factor f of the tone.
    """
    angle = tones[i, 0] * time_s
    c, s = error * cos(angle), error * sin(angle)
    real = learnt[i, 0] + tones[i, 1] * c + tones[i, 2] * s
    imaginary = -learnt[i, 1] + tones[i, 2] * c - tones[i, 1] * s
    size = sqrt(real * real + imaginary * imaginary)
    shrunk = select(size > tones[i, 3], tones[i, 3] / size, 1.0)
    learnt[i, 0] = select(where, shrunk * real, learnt[i, 0])
    learnt[i, 1] = select(where, -shrunk * imaginary, learnt[i, 1])
