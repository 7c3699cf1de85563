"""Which of a test's channels are recorded in which way, so that a night takes little of the disk.

Found by what each takes of the disk (docs/decisions/0036-size-of-recordings.md): two fifths of a
recording were estimates, which a replay makes again of the rest, bit for bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rig.channels import READINGS

OVERVIEW_PERIOD_S: Final = 0.02
"""Time from one row of the overview to the next, s. 50 rows a second are as many as a screen shows,
and take a twentieth of all rows."""

_SETPOINTS: Final = ("setpoint_m", "setpoint_V")
_SIGNALS: Final = (*_SETPOINTS, "command_V", *READINGS)
_REPLAYED: Final = ("est_", "innovation_", "residual_", "filter_resets")
"""Beginnings of the names of what a filter makes: its states, and its outputs
(`estimator.filters.registry.OUTPUTS`)."""


@dataclass(frozen=True)
class Division:
    """How the channels of a recording are divided.

    Attributes:
        signals: channels that have one message a sample: setpoint, command and readings, which are
            all that a filter consumes beside the time.
        details: channels that are kept in every sample too, but packed: `time_s` first, as each
            message has its own log time; what device, loop and slow drivers say of themselves; and
            decisions.
        replayed: channels that a replay makes again, bit for bit; of them only the overview has
            rows, rounded to float32.
    """

    signals: tuple[str, ...]
    details: tuple[str, ...]
    replayed: tuple[str, ...]

    @property
    def overview(self) -> tuple[str, ...]:
        """Channels of the overview: all but the time that are not in the message of a sample."""
        return (*self.replayed, *self.details[1:])


def division_of(channels: Sequence[str]) -> Division:
    """Return how the channels of a row that a loop writes are divided, each part in their order."""
    signals = tuple(name for name in channels if name in _SIGNALS)
    replayed = tuple(name for name in channels if name.startswith(_REPLAYED))
    taken = {*signals, *replayed}
    return Division(signals, tuple(name for name in channels if name not in taken), replayed)
