"""The log of a connected session, and the trip report that is made from it."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from rig.configuration import Rig
from rig.loop import Board, RingReader, TripError, Word, channel_name
from rig.supervisor.processes import Driven, News, trips_of

from .trip_report import Confirmation, Note, TripReport, kept_trip_report, trip_error

LAST_S: Final = 2.0
"""Length in s of the last samples of all channels that a trip report holds."""
LAST_NEWS_S: Final = 0.2
"""Time in s for which a trip report waits for reports of slow drivers after everything is safe."""

_STEPS: Final = {
    "valve null": Word.VALVE_NULL_AT,
    "bypass shut": Word.BYPASS_SHUT_AT,
    "pump unloaded": Word.PUMP_UNLOADED_AT,
}


def loop_channel(board: Board) -> str:
    """Return the name of the channel that the loop's action concerns; empty if it concerns none."""
    return channel_name(int(board.words[Word.ACTION_CHANNEL]))


class EventLog:
    """The log of a session: who did what, what another master drove, and the trip report.

    Args:
        rig: the rig's configuration.
        directory: folder of the run, in which a trip report is written.
        say: shows a line to the operator.
        journal: is called with a sentence when another master drives a part of the rig.
    """

    def __init__(
        self,
        rig: Rig,
        directory: Path,
        say: Callable[[str], None],
        journal: Callable[[str], None],
    ) -> None:
        self._rig = rig
        self._directory = directory
        self._say = say
        self._journal = journal
        self._notes: list[Note] = []
        self._driven: dict[tuple[str, str], Driven] = {}
        self._report: TripReport | None = None
        self._reported: Path | None = None

    @property
    def has_report(self) -> bool:
        """Whether a trip has been reported."""
        return self._report is not None

    def note(self, who: str, what: str) -> None:
        """Record who did what, at the present time."""
        self._notes.append(Note(time.monotonic_ns(), who, what))

    def take(self, news: News) -> None:
        """Record a part's report and show it to the operator; journal one on another master."""
        text = news.text
        if isinstance(news, Driven):
            self._driven[news.who, news.part] = news
            text = news.sentence
            self._journal(text)
        self._notes.append(Note(news.at_ns, news.who, text))
        self._say(f"{news.who}: {text}")

    def tripped(self, board: Board, channels: tuple[str, ...]) -> TripError:
        """Return the error of the trip; at the first call, make and write the trip report.

        Args:
            board: the memory that all processes share.
            channels: names of a row's columns.

        The first call waits for `LAST_NEWS_S`. If the report cannot be written, its lines are shown
        to the operator.
        """
        if self._report is None:
            # Slow drivers are read again now, and an error of one may be why the loop tripped.
            time.sleep(LAST_NEWS_S)
            self._report = self._trip_report(board, channels)
            self._reported = kept_trip_report(self._report, self._directory, self._say)
        return trip_error(self._report, self._reported)

    def _trip_report(self, board: Board, channels: tuple[str, ...]) -> TripReport:
        words = board.words
        return TripReport(
            trips=trips_of(board),
            confirmations=[Confirmation(what, int(words[at])) for what, at in _STEPS.items()],
            notes=tuple(self._notes),
            channels=channels,
            rows=RingReader(board).latest(round(LAST_S * self._rig.loop.rate)),
            channel=loop_channel(board),
            limits=self._rig.ladder,
            driven=tuple(self._driven.values()),
        )

    def complete_report(self) -> None:
        """Write the trip report anew if another master did something that is not in it.

        Without a trip report nothing is done.
        """
        report, driven = self._report, tuple(self._driven.values())
        if report is not None and report.driven != driven:
            self._report = replace(report, driven=driven, notes=tuple(self._notes))
            self._reported = kept_trip_report(
                self._report, self._directory, self._say, self._reported
            )
