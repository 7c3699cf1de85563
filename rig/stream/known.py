"""What a reader knows of a rig: its snapshot, the samples of a window, and gaps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from .received import Singles

Content = Mapping[str, Any]
Life = Literal["unheard", "live", "ended", "dead"]

DEAD_AFTER: Final = 4.0
"""Number of heartbeat periods without a message after which a stream counts as dead.

This is so even if its liveliness token is still there.
"""


class UnknownRigError(LookupError):
    """The error of a rig that is not known, or of no id while not exactly one rig is known."""


@dataclass(frozen=True)
class Gap:
    """A gap: messages or rows that did not arrive.

    Attributes:
        at_ns: time of the reader's `SteadyClock` when the gap was noticed, ns since 1970.
        kind: kind of the missing messages, or `rows` for rows of samples.
        missing: number of missing messages, or rows.
    """

    at_ns: int
    kind: str
    missing: int


@dataclass(frozen=True)
class Snapshot:
    """The knowledge that a reader has of a rig at one moment, as plain values in SI.

    Attributes:
        rig: the rig's id.
        session: name of the publisher's session; empty before any message came.
        alive: whether the rig's liveliness token is there and its last message came less than
            `DEAD_AFTER` heartbeat periods ago.
        age_s: time in s since its last message came; None if none ever came.
        restarts: number of times that a new session replaced an earlier one.
        names: names of the channels of the newest sample; empty if there is none.
        units: units of these channels.
        time_s: time of the newest sample within its test, s; NaN if there is none.
        test: number of the test that the newest sample belongs to; 0 outside of tests.
        latest: channel -> newest value in the newest message of samples; NaN if it has none. A
            device that is slower than the loop has no value in most samples.
        is_sampled: whether its present session has sent samples, the newest of which is `latest`;
            before that `latest` is of the session before.
        rate_hz: number of new samples that came in the last second, not counting past ones that
            were asked for.
        decision: content of the newest message `decision`, as in docs/stream.md; empty if none
            came. The same holds for `health`, `campaign`, `progress` and `state`.
        verdicts: the last decisions at which verdict or test changed, oldest first.
        events: the last events, oldest first.
        gaps: the last gaps, oldest first.
        missing: kind -> total number of its messages that did not arrive; `rows` -> that of rows of
            samples, less those that were asked for and came later.
        proven: whether the rig has proven to be this user's, by its signature (docs/stream.md).
            Then nothing that others say in its name is taken.
        refused: number of payloads on the rig's keys that were not valid messages, or were not the
            rig's although it is proven.
        refusal: why the last of these was not valid; empty if there was none.
    """

    rig: str
    session: str = ""
    alive: bool = False
    age_s: float | None = None
    restarts: int = 0
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    time_s: float = float("nan")
    test: int = 0
    latest: Mapping[str, float] = field(default_factory=dict)
    is_sampled: bool = False
    rate_hz: float = 0.0
    decision: Content = field(default_factory=dict)
    health: Content = field(default_factory=dict)
    campaign: Content = field(default_factory=dict)
    progress: Content = field(default_factory=dict)
    state: Content = field(default_factory=dict)
    verdicts: tuple[Content, ...] = ()
    events: tuple[Content, ...] = ()
    gaps: tuple[Gap, ...] = ()
    missing: Mapping[str, int] = field(default_factory=dict)
    proven: bool = False
    refused: int = 0
    refusal: str = ""

    @property
    def life(self) -> Life:
        """Whether the rig is there.

        It is `unheard` if no message came yet, and `live` if it is alive. Otherwise it is `ended`
        if its campaign was reported as ended, and `dead` if not.
        """
        if self.age_s is None:
            return "unheard"
        if self.alive:
            return "live"
        return "ended" if self.campaign.get("status") == "ended" else "dead"


@dataclass(frozen=True)
class Window:
    """The last samples of a rig, oldest first.

    Attributes:
        row: (n,) number of each sample's row within the run; a jump is a gap.
        time_s: (n,) time of each sample within its test, s.
        test: (n,) number of each sample's test.
        values: channel -> (n,) values, SI; NaN where it was not measured or not sent.
    """

    row: NDArray[np.int64]
    time_s: NDArray[np.float64]
    test: NDArray[np.int64]
    values: Mapping[str, Singles]
