"""The times that stand in an MCAP file several times are compared here.

Each message has a log time and a publish time, by which viewers place it, and a row or event has
its own `time_s`, by which this program reads it. `McapWriter` writes both times as the beginning of
the recording, `start_ns` of its metadata, plus `time_s` rounded to nanoseconds. A file where they
differ shows another recording to a viewer than to this program, although all checksums are right.
"""

import numpy as np
from numpy.typing import NDArray

_LATEST_S = 4e9
"""Later times since the beginning, s, are not compared: in nanoseconds they may not fit into 64
bits. `McapWriter` writes no time later than 4.6e9 s."""


class LogTimes:
    """Comparisons of the times of one file's messages.

    Attributes:
        start_ns: log time of what happens at `time_s` = 0; None until the metadata or, in a file
            without, the first message have told it.
        wrong: number of messages so far whose times contradict each other.
        first: a sentence on the first of them; "" if there is none.
    """

    def __init__(self) -> None:
        self.start_ns: int | None = None
        self.wrong = 0
        self.first = ""
        self._span: tuple[int, int] | None = None

    def compare(
        self, topic: str, time_s: NDArray[np.float64], log_times: NDArray[np.uint64]
    ) -> None:
        """Compare the log times of messages (n,), ns, with the times (n,) in them, s."""
        comparable = np.isfinite(time_s) & (np.abs(time_s) < _LATEST_S)
        since_ns = np.rint(np.where(comparable, time_s, 0.0) * 1e9).astype(np.int64)
        if self.start_ns is None:
            if not comparable.any():
                return
            at = int(np.argmax(comparable))
            self.start_ns = int(log_times[at]) - int(since_ns[at])
        # Numbers of 64 bits without a sign are added modulo 2^64, which undoes a negative time.
        start = np.uint64(self.start_ns % 2**64)
        differs = comparable & (since_ns.astype(np.uint64) + start != log_times)
        if differs.any():
            at = int(np.argmax(differs))
            later_s = (int(log_times[at]) - self.start_ns - int(since_ns[at])) * 1e-9
            self._note(
                int(np.count_nonzero(differs)),
                f"a message of {topic} says that it is of {time_s[at]:.9g} s, and its log time is "
                f"{abs(later_s):.9g} s {'later' if later_s > 0.0 else 'earlier'}",
            )

    def compare_published(
        self, topic: str, log_times: NDArray[np.uint64], publish_times: NDArray[np.uint64]
    ) -> None:
        """Compare the log times of messages (n,) with their publish times (n,), both in ns."""
        differs = log_times != publish_times
        if differs.any():
            at = int(np.argmax(differs))
            later_s = (int(publish_times[at]) - int(log_times[at])) * 1e-9
            self._note(
                int(np.count_nonzero(differs)),
                f"the publish time of a message of {topic} is {abs(later_s):.9g} s "
                f"{'later' if later_s > 0.0 else 'earlier'} than its log time",
            )

    def compare_overview(
        self, topic: str, time_s: NDArray[np.float64], log_times: NDArray[np.uint64]
    ) -> None:
        """Look whether each message of the overview has the log time of one of the samples.

        Args:
            topic: topic of the overview.
            time_s: (n,) times of all samples, s.
            log_times: (m,) log times of the overview's messages, ns.
        """
        if self.start_ns is None or not np.isfinite(time_s).all():
            return
        nearest = np.abs(time_s) < _LATEST_S
        of_samples = np.rint(time_s[nearest] * 1e9).astype(np.int64).astype(np.uint64)
        differs = ~np.isin(log_times, of_samples + np.uint64(self.start_ns % 2**64))
        if differs.any():
            since_s = (int(log_times[int(np.argmax(differs))]) - self.start_ns) * 1e-9
            text = f"a message of {topic} has a log time, {since_s:.9g} s, at which no sample is"
            self._note(int(np.count_nonzero(differs)), text)

    def seen(self, log_times: NDArray[np.uint64]) -> None:
        """Count log times (n,), n > 0, among those of the present chunk."""
        first, last = int(log_times.min()), int(log_times.max())
        self._span = (first, last) if self._span is None else (
            min(first, self._span[0]), max(last, self._span[1])
        )  # fmt: skip

    def end_chunk(self, start_ns: int, end_ns: int) -> None:
        """Compare the log times seen since the last chunk with those that the chunk says."""
        span, self._span = self._span, None
        if span is not None and span != (start_ns, end_ns):
            since, until = 1e-9 * start_ns, 1e-9 * end_ns
            text = f"a chunk says that it is of log time {since:.9g} s to {until:.9g} s, and is not"
            self._note(1, text)

    def _note(self, count: int, text: str) -> None:
        self.wrong += count
        self.first = self.first or text
