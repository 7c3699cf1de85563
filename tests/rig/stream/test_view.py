"""A reader knows what is so now, whether it is alive, and everything that is missing."""

from typing import Any

import numpy as np
import pytest

from rig.stream.known import Gap
from rig.stream.messages import MessageError, Samples
from rig.stream.view import RigView

S = 10**9
CHANNELS = {"id": 1, "names": ["position_m", "command_V"], "units": ["m", "V"]}


class Publisher:
    """Makes messages as a publisher does, and has a view take some of them."""

    def __init__(self, view: RigView, session: str = "s1") -> None:
        self.view, self.session = view, session
        self.sequences: dict[str, int] = {}

    def message(self, kind: str, content: dict[str, Any]) -> dict[str, Any]:
        self.sequences[kind] = self.sequences.get(kind, -1) + 1
        header = {"version": 1, "session": self.session, "sequence": self.sequences[kind]}
        return {**header, "sent_ns": 0, **content}

    def send(self, kind: str, content: dict[str, Any], at_ns: int = 0, lost: bool = False) -> None:
        message = self.message(kind, content)
        if not lost:
            self.view.take(kind, message, at_ns)

    def samples(self, first_row: int, rows: int = 10, at_ns: int = 0, lost: bool = False) -> None:
        content = batch(first_row, rows).content()
        self.send("samples", content, at_ns, lost)

    def heartbeat(self, at_ns: int = 0) -> None:
        self.send("heartbeat", {"heartbeat_s": 0.5, "sequences": dict(self.sequences)}, at_ns)


def batch(first_row: int, rows: int = 10) -> Samples:
    numbers = np.arange(first_row, first_row + rows)
    values = np.column_stack([numbers, -numbers]).astype(np.float32)
    return Samples(1, first_row, 1, 0, np.asarray(numbers * 1e-3, np.float64), values)


@pytest.fixture
def view() -> RigView:
    return RigView("bench")


@pytest.fixture
def publisher(view: RigView) -> Publisher:
    publisher = Publisher(view)
    publisher.send("channels", CHANNELS)
    view.has_token = True
    return publisher


def test_the_newest_values_have_their_names(view: RigView, publisher: Publisher) -> None:
    publisher.samples(0)
    snapshot = view.snapshot(0)
    assert snapshot.latest == {"position_m": 9.0, "command_V": -9.0}
    assert snapshot.units == ("m", "V")
    assert snapshot.missing == {}


def test_of_a_device_slower_than_the_loop_the_newest_value_of_a_message_is_told(
    view: RigView, publisher: Publisher
) -> None:
    samples = batch(0)
    samples.values[8:, 0] = samples.values[:, 1] = np.nan
    publisher.send("samples", samples.content())
    latest = view.snapshot(0).latest
    assert latest["position_m"] == 7.0
    assert np.isnan(latest["command_V"])


def test_messages_that_were_lost_are_counted_by_kind_and_row(
    view: RigView, publisher: Publisher
) -> None:
    publisher.samples(0)
    publisher.samples(10, lost=True)
    publisher.samples(20, lost=True)
    publisher.samples(30, at_ns=S)
    assert view.snapshot(S).missing == {"samples": 2, "rows": 20}
    assert Gap(S, "rows", 20) in view.snapshot(S).gaps


def test_rows_that_were_never_sent_are_missing(view: RigView, publisher: Publisher) -> None:
    publisher.samples(0)
    publisher.samples(500)
    assert view.snapshot(0).missing == {"rows": 490}


def test_a_heartbeat_tells_of_a_loss_that_nothing_follows(
    view: RigView, publisher: Publisher
) -> None:
    publisher.samples(0)
    publisher.send("event", {"text": "a"})
    publisher.send("event", {"text": "b"}, lost=True)
    publisher.heartbeat()
    publisher.heartbeat()
    assert view.snapshot(0).missing == {"event": 1}


def test_joining_late_is_no_gap(view: RigView, publisher: Publisher) -> None:
    publisher.sequences["samples"] = 1000
    publisher.samples(20_000)
    assert view.snapshot(0).missing == {}


def test_a_publisher_that_begins_anew_is_reported_with_the_rows_that_it_missed(
    view: RigView, publisher: Publisher
) -> None:
    publisher.samples(0)
    assert view.snapshot(0).is_sampled
    again = Publisher(view, "s2")
    again.send("channels", CHANNELS)
    assert view.snapshot(0).latest
    assert not view.snapshot(0).is_sampled
    again.samples(1010)
    snapshot = view.snapshot(0)
    assert snapshot.is_sampled
    assert (snapshot.session, snapshot.restarts) == ("s2", 1)
    assert snapshot.missing == {"rows": 1000}


def test_the_rows_of_another_run_are_not_mixed_with_those_of_this_one(
    view: RigView, publisher: Publisher
) -> None:
    publisher.send("channels", CHANNELS)
    publisher.samples(500)
    again = Publisher(view, "s2")
    again.send("channels", CHANNELS)
    again.samples(0)
    assert view.window(30.0).row.tolist() == list(range(10))
    past = again.message("samples", batch(20).content())
    view.take_past("samples", past, 0)
    assert view.window(30.0).row[-1] == 29


def test_a_silent_stream_is_dead_with_its_age(view: RigView, publisher: Publisher) -> None:
    publisher.heartbeat(at_ns=S)
    assert view.snapshot(2 * S).alive
    snapshot = view.snapshot(11 * S)
    assert (snapshot.alive, snapshot.age_s) == (False, 10.0)


def test_a_stream_whose_token_went_is_dead_at_once(view: RigView, publisher: Publisher) -> None:
    publisher.heartbeat(at_ns=S)
    view.has_token = False
    assert not view.snapshot(S).alive


def test_a_rig_that_said_goodbye_has_ended_and_one_that_went_silent_is_dead(
    view: RigView, publisher: Publisher
) -> None:
    assert view.snapshot(S).life == "live"
    publisher.send("campaign", {"status": "ended"}, at_ns=S)
    assert view.snapshot(S).life == "live"
    view.has_token = False
    assert view.snapshot(S).life == "ended"
    again = Publisher(view, "s2")
    again.heartbeat(at_ns=2 * S)
    assert view.snapshot(2 * S).life == "dead"


def test_what_an_earlier_publisher_told_of_its_test_is_not_so_now(
    view: RigView, publisher: Publisher
) -> None:
    told: dict[str, dict[str, Any]] = {
        "progress": {"number": 2},
        "decision": {"verdict": "internal_leakage", "test": 2},
        "campaign": {"status": "ended"},
        "health": {"trips": {"first_out": []}},
    }
    for kind, content in told.items():
        publisher.send(kind, content)
        assert getattr(view.snapshot(0), kind)
    Publisher(view, "s2").heartbeat()
    assert [getattr(view.snapshot(0), kind) for kind in told] == [{}] * 4
    assert view.snapshot(0).verdicts


def test_an_answer_of_a_new_publisher_counts_however_far_the_earlier_one_had_counted(
    view: RigView, publisher: Publisher
) -> None:
    """What was sent before anybody was connected comes as an answer only."""
    for _ in range(5):
        publisher.send("campaign", {"status": "ended"})
    again = Publisher(view, "s2")
    again.heartbeat()
    view.take_past("campaign", again.message("campaign", {"status": "running"}), 0)
    assert view.snapshot(0).campaign["status"] == "running"


def test_a_new_session_that_was_only_asked_is_not_heard_yet_and_has_not_the_old_one_s_samples(
    view: RigView, publisher: Publisher
) -> None:
    publisher.samples(0, at_ns=S)
    assert view.snapshot(S).rate_hz > 0.0
    again = Publisher(view, "s2")
    view.take_past("campaign", again.message("campaign", {"status": "running"}), 9 * S)
    found = view.snapshot(9 * S)
    assert (found.life, found.age_s, found.campaign["status"]) == ("unheard", None, "running")
    publisher = Publisher(view, "s3")
    publisher.heartbeat(at_ns=S + S // 2)
    assert (view.snapshot(S + S // 2).life, view.snapshot(S + S // 2).rate_hz) == ("live", 0.0)


def test_a_late_joiner_puts_the_past_before_the_present(
    view: RigView, publisher: Publisher
) -> None:
    past = [publisher.message("samples", batch(first).content()) for first in (0, 10)]
    publisher.samples(20)
    for message in past:
        view.take_past("samples", message, 0)
    window = view.window(10.0)
    np.testing.assert_array_equal(window.row, np.arange(30))
    np.testing.assert_array_equal(window.values["command_V"], -np.arange(30.0))
    assert view.snapshot(0).missing == {}


def test_what_was_asked_for_and_came_by_itself_is_there_once(
    view: RigView, publisher: Publisher
) -> None:
    message = publisher.message("samples", batch(0).content())
    view.take("samples", message, 0)
    view.take_past("samples", message, 0)
    assert len(view.window(10.0).row) == 10
    event = publisher.message("event", {"text": "a"})
    view.take("event", event, 0)
    view.take_past("event", event, 0)
    assert len(view.snapshot(0).events) == 1


def test_what_came_by_itself_after_it_was_asked_for_is_there_once(
    view: RigView, publisher: Publisher
) -> None:
    """An answer may overtake what still waits to be taken."""
    batches = [publisher.message("samples", batch(first).content()) for first in (0, 10)]
    event = publisher.message("event", {"text": "a"})
    for kind, content in (("samples", batches[0]), ("samples", batches[1]), ("event", event)):
        view.take_past(kind, content, 0)
    for kind, content in (("samples", batches[0]), ("samples", batches[1]), ("event", event)):
        view.take(kind, content, 0)
    publisher.samples(20)
    assert view.window(10.0).row.tolist() == list(range(30))
    assert len(view.snapshot(0).events) == 1
    assert view.snapshot(0).missing == {}


def test_rows_that_come_after_all_are_missing_no_more(view: RigView, publisher: Publisher) -> None:
    publisher.samples(0)
    again = Publisher(view, "s2")
    past = [
        ("channels", again.message("channels", CHANNELS)),
        *(("samples", again.message("samples", batch(first).content())) for first in (20, 30)),
    ]
    again.samples(40)
    # What the rows from 40 on are is not known, and those from 10 on did not come.
    assert view.snapshot(0).missing == {"rows": 40}
    for kind, message in past:
        view.take_past(kind, message, 0)
    assert view.snapshot(0).missing == {"rows": 20}
    for first in (10, 40):
        view.take_past("samples", again.message("samples", batch(first).content()), 0)
    assert view.snapshot(0).missing == {}
    assert view.window(10.0).row.tolist() == list(range(50))


def test_the_past_of_an_earlier_publisher_is_left_out(view: RigView) -> None:
    old, new = Publisher(view, "s1"), Publisher(view, "s2")
    message = {**old.message("state", {"state": "old"}), "sent_ns": 1}
    new.send("heartbeat", {"heartbeat_s": 0.5, "sequences": {}, "sent_ns": 2})
    view.take_past("state", message, 0)
    assert (view.session, view.snapshot(0).state) == ("s2", {})


def test_an_answer_does_not_replace_what_is_newer(view: RigView, publisher: Publisher) -> None:
    old = publisher.message("state", {"state": "armed"})
    publisher.send("state", {"state": "running"})
    view.take_past("state", old, 0)
    assert view.snapshot(0).state["state"] == "running"


def test_the_window_is_as_long_as_asked(view: RigView, publisher: Publisher) -> None:
    for first in range(0, 5000, 20):
        publisher.samples(first, 20, at_ns=first * 10**6)
    assert view.window(1.0).time_s[0] == pytest.approx(4.0, abs=0.021)
    assert len(view.window(1.0, ("position_m",)).values) == 1


def test_old_samples_are_given_up(publisher: Publisher) -> None:
    view = RigView("bench", window_s=1.0)
    publisher.view = view
    publisher.send("channels", CHANNELS)
    for first in range(0, 5000, 20):
        publisher.samples(first, 20, at_ns=first * 10**6)
    assert len(view.window(100.0).row) <= 1020


def test_verdicts_are_kept_when_they_change(view: RigView, publisher: Publisher) -> None:
    for verdict in ("healthy", "healthy", "internal_leakage", "healthy"):
        publisher.send("decision", {"verdict": verdict, "test": 1})
    verdicts = [told["verdict"] for told in view.snapshot(0).verdicts]
    assert verdicts == ["healthy", "internal_leakage", "healthy"]


def test_the_verdict_of_a_new_run_is_reported_though_it_is_that_of_the_run_before(
    view: RigView, publisher: Publisher
) -> None:
    for begun_ns in (1, 1, 2):
        publisher.send("campaign", {"begun_ns": begun_ns})
        publisher.send("decision", {"verdict": "healthy", "test": 1})
    assert len(view.snapshot(0).verdicts) == 2


def test_nothing_is_known_before_anything_came(view: RigView) -> None:
    snapshot = view.snapshot(0)
    assert (snapshot.alive, snapshot.age_s, snapshot.latest) == (False, None, {})
    assert len(view.window(10.0).row) == 0


def test_samples_of_channels_that_are_not_known_yet_are_left_out_and_asked_for(
    view: RigView,
) -> None:
    publisher = Publisher(view)
    publisher.send("channels", CHANNELS, lost=True)
    publisher.samples(0, at_ns=S)
    assert len(view.window(10.0).row) == 0
    assert view.to_ask_again() == (frozenset({"channels", "samples"}), S)
    assert view.to_ask_again()[0] == frozenset()
    publisher.sequences.clear()
    view.take_past("channels", publisher.message("channels", CHANNELS), S)
    publisher.samples(10, at_ns=S)
    view.take_past("samples", publisher.message("samples", batch(0).content()), S)
    assert view.window(10.0).row.tolist() == list(range(20))


def test_of_what_was_lost_only_what_does_not_come_anew_is_asked_for(
    view: RigView, publisher: Publisher
) -> None:
    publisher.samples(0, at_ns=S)
    for kind in ("state", "health", "progress"):
        publisher.send(kind, {}, at_ns=2 * S)
        publisher.send(kind, {}, lost=True)
    publisher.heartbeat(at_ns=3 * S)
    assert view.to_ask_again() == (frozenset({"state"}), 2 * S)
    publisher.samples(10, lost=True)
    publisher.samples(20, at_ns=4 * S)
    publisher.samples(40, at_ns=5 * S)  # of rows that were never sent there is nothing to ask for
    assert view.to_ask_again() == (frozenset({"samples"}), 3 * S)


def test_a_heartbeat_without_its_numbers_is_refused(view: RigView, publisher: Publisher) -> None:
    with pytest.raises(MessageError):
        publisher.send("heartbeat", {"heartbeat_s": "x", "sequences": []})
