"""The feed holds all that viewers are sent: sections, each numbered at its last change, and curves.

Each viewer is sent only what is newer than what it has. A slow viewer delays nobody else: it is
sent fewer messages, each with the newest content.
"""

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from rig.stream import Life, Snapshot, StreamClient
from rig.surviving import Surviving

from .curves import AVERAGED_S, CHANNELS, KEPT, SHOWN_S, Curves
from .history import MOST_RIGS, History
from .snapshot_sections import sections, unseen_trips

TICK_S: Final = 0.05
NOTICED_S: Final = 0.2
"""Period in s at which numbers and lists are updated; curves are updated in every tick."""
CAUGHT_UP_S: Final = 0.3
"""Length in s of the stretch that is searched for new rows in each tick."""
PAST_COMES_S: Final = (0.5, 2.0, 6.0)
"""Times in s after the first message of a session at which the curves are made anew.

They then include the past samples, which the client asks for and which arrive after present ones.
"""
REFUSED_S: Final = 10.0
"""Shortest time in s between two notices about unreadable messages on a rig's keys."""
LISTENS_S: Final = 5.0
"""Time in s for which a console that hears no rig says that it has only begun to listen.

A rig tells its state each second and its publisher answers a new listener within one more; the rest
is for a machine that is busy, as when the console was started again beside a rig that runs.
"""
NOTICES: Final = 40
USUAL_PERIOD_S: Final = 1e-3


class Sections:
    """The JSON text of each section, with the number of its last change.

    Changes of all sections are numbered together; `number` is the newest one.
    """

    def __init__(self) -> None:
        self._held: dict[str, tuple[int, str]] = {}
        self.number = 0
        self._lock = threading.Lock()

    def put(self, name: str, content: Any) -> None:
        """Set a section's content; if its JSON differs from before, give the change a new number.

        The content must be JSON values without NaN and infinity.
        """
        text = json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
        # The lock is needed as orders are carried out, and reported, in threads.
        with self._lock:
            if self._held.get(name, (0, ""))[1] != text:
                self.number += 1
                self._held[name] = (self.number, text)

    def since(self, number: int) -> dict[str, str]:
        """Return the JSON of the sections whose last change has a higher number than this."""
        return {name: text for name, (at, text) in self._held.items() if at > number}


class RigFeed:
    """The sections and curves of one rig, which are updated from its stream.

    Args:
        rig: the rig's id.
        is_kept: whether its history is kept too.
    """

    def __init__(self, rig: str, *, is_kept: bool = True) -> None:
        self.rig = rig
        self.sections = Sections()
        self.curves = Curves()
        self.history = History(KEPT) if is_kept else None
        self._session = ""
        self._unseen: list[dict[str, Any]] = []
        """The trips that nobody had acknowledged when the rig's station was heard last."""
        self._noticed_at = 0.0
        self._anew: list[float] = []
        self._period_s = USUAL_PERIOD_S
        self._refused = 0
        self._refused_at = -REFUSED_S

    def look(self, snapshot: Snapshot, now: float, notice: Callable[[str], None]) -> None:
        """Call `notice` with a line if the rig's snapshot counts new unreadable messages.

        That happens once in `REFUSED_S` at most. `now` is a monotonic time in s.
        """
        new = snapshot.refused - self._refused
        if new and now - self._refused_at >= REFUSED_S:
            self._refused, self._refused_at = snapshot.refused, now
            notice(f"{self.rig}: {new} messages refused, the last: {snapshot.refusal}")

    def follow(self, client: StreamClient, snapshot: Snapshot, now: float) -> None:
        """Update the curves with what the client received; every `NOTICED_S` the sections too.

        After a new session of the stream has begun, the curves are made anew at the times
        `PAST_COMES_S`; while it sends no samples, as before its rig is connected, they stay. `now`
        is a monotonic time in s.
        """
        if now - self._noticed_at >= NOTICED_S:
            self._noticed_at = now
            shown = sections(snapshot)
            # Only the station tells of them, and is not heard while somebody drives.
            if shown["last"]:
                self._unseen = unseen_trips(shown["last"])
            elif self._unseen:
                shown["last"] = {"unseen": self._unseen}
            for name, content in shown.items():
                self.sections.put(name, content)
            if snapshot.session != self._session:
                self._session = snapshot.session
                self._anew = [now + later for later in PAST_COMES_S]
        if not snapshot.rate_hz:
            # What the client holds was taken before, or is of the session before.
            return
        if self._anew and now >= self._anew[0]:
            del self._anew[0]
            self.curves.begin()
        last_s = CAUGHT_UP_S if self.curves.points else SHOWN_S + AVERAGED_S
        window = client.window(last_s, CHANNELS, self.rig)
        if len(window.row) > 1:
            steps = np.diff(window.time_s)
            period_s = float(np.median(steps)) if np.isfinite(steps).all() else 0.0
            if 1e-5 < period_s < 1.0:
                self._period_s = period_s
        taken = self.curves.take(window, self._period_s)
        if taken is not None and self.history is not None:
            self.history.take(taken, time.time_ns() * 1e-9)


class Cursor:
    """A record of the rig that one viewer looks at, and of how much it was sent already.

    `common` and `own` are numbers of changes in the common sections and in the rig's; `points` is
    the count of the rig's points.
    """

    def __init__(self) -> None:
        self.rig = ""
        self.common = self.own = self.points = 0

    def choose(self, rig: str) -> None:
        """Set the rig that the viewer looks at, and note that nothing of it was sent yet."""
        self.rig, self.own, self.points = rig, 0, 0


class Feed:
    """The content that viewers are sent about all rigs, and about the console itself.

    Args:
        client: follows the streams; it is not closed here.

    Attributes:
        common: the sections about the console itself.
        listens_until: monotonic time in s before which that no rig is heard tells nothing yet;
            None before the first tick.
    """

    def __init__(self, client: StreamClient) -> None:
        self._client = client
        self.listens_until: float | None = None
        self._rigs: dict[str, RigFeed] = {}
        self._notices: deque[dict[str, Any]] = deque(maxlen=NOTICES)
        self.common = Sections()
        self.common.put("notices", [])
        self.common.put("listening", True)
        self._survives = Surviving("showing a rig", self.notice)

    def tick(self, now: float) -> None:
        """Update the content of every rig with what the client received since the last tick.

        `now` is a monotonic time in s. An error with one rig becomes a notice and stops no other.
        """
        living: dict[str, Life] = {}
        snapshots = {snapshot.rig: snapshot for snapshot in self._client.snapshots()}
        self._rigs = {rig: feed for rig, feed in self._rigs.items() if rig in snapshots}
        for rig, snapshot in snapshots.items():
            if rig not in self._rigs:
                self._rigs[rig] = RigFeed(rig, is_kept=len(self._rigs) < MOST_RIGS)
            feed = self._rigs[rig]
            # The life is noted first: a rig whose data cannot be shown still counts as alive.
            living[rig] = snapshot.life
            with self._survives:
                feed.follow(self._client, snapshot, now)
            feed.look(snapshot, now, self.notice)
        self.common.put("rigs", [{"rig": rig, "life": life} for rig, life in living.items()])
        if self.listens_until is None:
            self.listens_until = now + LISTENS_S
        self.common.put("listening", now < self.listens_until)

    def notice(self, text: str) -> None:
        """Add a notice, with the present time, to the list that all viewers are shown."""
        self._notices.append({"at_ms": time.time_ns() // 10**6, "text": text})
        self.common.put("notices", list(self._notices))

    def history(self, rig: str) -> History | None:
        """Return the history of a rig; None if the rig is not known, or its history not kept."""
        feed = self._rigs.get(rig)
        return None if feed is None else feed.history

    def news(self, cursor: Cursor) -> str | None:
        """Return a JSON text with all that a viewer was not sent yet; None if nothing is new.

        The cursor is updated. If its rig is not known, it is set to one that is, by preference one
        whose stream is alive, or to "" if there is none.
        """
        if cursor.rig not in self._rigs:
            cursor.choose(next(iter(self._client.living() or self._client.rigs()), ""))
        common = self.common.since(cursor.common)
        cursor.common = self.common.number
        parts = [f'"common":{_object(common)}'] if common else []
        feed = self._rigs.get(cursor.rig)
        if feed is not None:
            own = feed.sections.since(cursor.own)
            cursor.own = feed.sections.number
            points = feed.curves.since(cursor.points)
            cursor.points = feed.curves.count
            parts += [f'"sections":{_object(own)}'] if own else []
            parts += [f'"points":{json.dumps(points, allow_nan=False)}'] if points else []
        if not parts:
            return None
        return f'{{"rig":{json.dumps(cursor.rig)},{",".join(parts)}}}'


def _object(texts: Mapping[str, str]) -> str:
    return "{" + ",".join(f"{json.dumps(name)}:{text}" for name, text in texts.items()) + "}"
