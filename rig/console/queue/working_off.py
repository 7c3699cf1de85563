"""Works the queue off: the next campaign is started when nothing runs, until something goes wrong.

That goes on only while somebody wants it: a console that is started anew starts nothing by itself.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rig.console.launcher import Launched, Launcher, LaunchRefused, killed_by
from rig.stream import StreamClient

from .queue_file import Content, QueueError, QueueFile

GOES_ON: Final = (0, 1)
"""Exit codes after which the next campaign is started: the run came to its end, whatever it found.
After a trip, a stop, bad input or a kill somebody should look at the rig first."""
HALT_S: Final = 0.5
"""Longest time in s for which a stop waits for a start that is being made. It takes some
hundredths; a disk that hangs must not hold up the stop."""


class Queue:
    """The queue of a console, with whether it is worked off, for whom, and why not any more.

    Its methods may be called from any thread.

    Args:
        file: holds the entries.
        launcher: starts the campaigns.
        client: tells whether a rig is in use, and how what used it ended.
        say: is called with a sentence when the queue starts a campaign, or halts.
    """

    def __init__(
        self, file: QueueFile, launcher: Launcher, client: StreamClient, say: Callable[[str], None]
    ) -> None:
        self.file = file
        self._launcher = launcher
        self._client = client
        self._say = say
        self._held = Content()
        self._problem = ""
        self._by = ""
        """Who has the queue worked off; empty while it is not."""
        self._why = ""
        self._running: Launched | None = None
        """The run that was seen last to be going on here; its end decides whether to go on."""
        self._excused: Launched | None = None
        """A run that had been stopped and was still ending when the queue was started."""
        self._awaited = ""
        """What is waited for, in words; empty while nothing is."""
        self._awaited_rig = ""
        """The rig that is waited for, as something else drives it."""
        self._awaited_begun: Any = None
        """When what is waited for began, as its stream says it."""
        self._starting = threading.Lock()
        """This lock is held while a campaign is started."""
        self._deciding = threading.Lock()
        """This lock is held while it is decided whether the queue is worked off."""
        self._halts = 0
        """How often something was stopped or went wrong, so that a start knows what came amid."""

    def offer(self) -> None:
        """Note in the file which campaigns this console offers; a problem is shown on the page."""
        self._take(lambda: self.file.offer(self._launcher.offers))

    def add(self, campaign: str, by: str, mark: str = "") -> None:
        """Add an offered campaign; a `QueueError` is raised if that cannot be done.

        A request with a `mark` that was carried out before changes nothing.
        """
        self._held = self.file.add(campaign, by, mark)

    def remove(self, number: str) -> None:
        """Remove the entry of a number; a `QueueError` is raised if there is none."""
        self._held = self.file.remove(_number(number))

    def move(self, number: str, way: str) -> None:
        """Move an entry "earlier", "later" or "first"; a `QueueError` is raised if it cannot be."""
        if way not in ("earlier", "later", "first"):
            raise QueueError("an entry is moved earlier, later or first")
        self._held = self.file.move(_number(number), way)  # type: ignore[arg-type]

    def begin(self, by: str, first: str = "") -> None:
        """Have the queue worked off from now on.

        Args:
            by: who wants that.
            first: number of the entry that is meant to begin; empty for whichever is the first.

        Raises:
            QueueError: nothing is queued, another entry is the first, the file cannot be used, or
                somebody has stopped while it was read.
        """
        halts = self._halts
        self._held = self.file.read()
        if not self._held.entries:
            raise QueueError("nothing is queued; add a campaign first")
        head = self._held.entries[0]
        if first and str(head.number) != first:
            raise QueueError(f"{head.campaign} comes first by now; see what its start would do")
        running = self._launcher.present()
        # Whoever starts the queue knows of a run that was stopped: its exit code is no news.
        self._excused = running if running is not None and running.stopped else None
        self._running, self._awaited, self._awaited_rig = None, "", ""
        with self._deciding:
            if self._halts != halts:
                raise QueueError("somebody has stopped meanwhile; start the queue again")
            self._by, self._why = by, ""

    def halt(self, why: str) -> None:
        """Start nothing more. What runs goes on.

        A start that is being made is waited for, for `HALT_S` at most, so that whoever stops
        everything finds the run that was started. One that takes longer stops its run itself.
        """
        with self._deciding:
            self._halts += 1
            halts = bool(self._by)
            if halts:
                self._by, self._why = "", why
        if halts:
            self._say(f"the queue halts: {why}")
        if self._starting.acquire(timeout=HALT_S):
            self._starting.release()

    def look(self) -> None:
        """Take the file's changes, and start the next campaign if it is time for it."""
        self._take(self.file.read)
        if not self._by:
            return
        running = self._launcher.present()
        if running is not None:
            self._running = None if running is self._excused else running
            self._awaited = f"waits for the end of {running.name}"
            return
        self._awaited = ""
        before, self._running = self._running, None
        if before is not None and before.exit_code not in GOES_ON:
            killed = killed_by(before.exit_code)
            how = f"was {killed}" if killed else f"ended with exit code {before.exit_code}"
            self.halt(f"{before.name} {how}")
            return
        if self._problem:
            self.halt(self._problem)
        elif not self._held.entries:
            self._by, self._why = "", "all that was queued has run"
        else:
            self._start_next()

    def content(self) -> dict[str, Any]:
        """Return entries, for whom they are worked off, and what is to be said, as JSON values."""
        return {
            "entries": [
                {"number": each.number, "campaign": each.campaign, "by": each.by,
                 "at_ms": each.at_ms, "begun": each.is_begun}
                for each in self._held.entries
            ],
            "marks": list(self._held.marks),
            "by": self._by,
            "why": self._problem or (self._awaited if self._by else self._why),
        }  # fmt: skip

    def _take(self, read: Callable[[], Content]) -> None:
        try:
            self._held, self._problem = read(), ""
        except QueueError as error:
            self._problem = str(error)

    def _start_next(self) -> None:
        entry = self._held.entries[0]
        rig = Path(self._launcher.rig_of(entry.campaign)).stem
        if entry.is_begun:
            text = "was about to be started when the console ended"
            self.halt(
                f"{entry.campaign} {text}; see whether it ran, then remove it or queue it anew"
            )
            return
        if rig in self._client.living() and self._status(rig) != "idle":
            self._awaited_rig = rig
            self._awaited_begun = self._client.snapshot(rig).campaign.get("begun_ns")
            self._awaited = f"waits for {rig}, which something else drives"
            return
        if self._awaited_rig == rig:
            self._awaited_rig = ""
            if ended_badly := self._ended_badly(rig):
                self.halt(ended_badly)
                return
        with self._starting:
            try:
                self._held = self.file.begin(entry.number, True)
                if not self._by:  # somebody has stopped while the disk was written
                    self._held = self.file.begin(entry.number, False)
                    return
                by = entry.by if entry.by == self._by else f"{entry.by}, queue of {self._by}"
                self._launcher.start(entry.campaign, by)
                self._running = self._launcher.present()
                self._say(f"{entry.campaign}, queued by {entry.by}, is started from the queue")
                if not self._by:  # a stop that found no run yet, as the disk hung, holds for it
                    self._launcher.stop(self._why)
                self._held = self.file.remove(entry.number)
            except LaunchRefused as refusal:
                problem = f"{entry.campaign} was not started: {refusal}"
                with suppress(QueueError):
                    self._held = self.file.begin(entry.number, False)
            except QueueError as error:
                problem = str(error)
            else:
                return
        self.halt(problem)

    def _status(self, rig: str) -> str:
        return str(self._client.snapshot(rig).campaign.get("status"))

    def _ended_badly(self, rig: str) -> str:
        """Return how what drove a rig ended, if somebody should look at it; "" if all is well."""
        if self._status(rig) == "running":
            return f"what drove {rig} has fallen silent"
        campaign = self._client.snapshot(rig).campaign
        if campaign.get("begun_ns") != self._awaited_begun:
            return f"how what drove {rig} ended was not seen"
        code = campaign.get("exit_code")
        if code in (None, *GOES_ON):
            return ""
        return f"what drove {rig} ended with exit code {code}"


def _number(text: str) -> int:
    if not text.isdecimal() or len(text) > 9:
        raise QueueError("name the entry by its number")
    return int(text)
