"""What all viewers are sent goes on, whatever one rig's stream holds."""

import json
from typing import Any

import pytest

from rig.console.feed import LISTENS_S, REFUSED_S, Cursor, Feed, RigFeed

from .fakes import RUNNING, FakeClient


def told(feed: Feed) -> dict[str, Any]:
    news = feed.news(Cursor())
    assert news is not None
    common: dict[str, Any] = json.loads(news)["common"]
    return common


def test_a_rig_that_cannot_be_shown_is_not_dead_and_viewers_are_shown_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("of a curve")

    feed = Feed(FakeClient(RUNNING))
    monkeypatch.setattr(RigFeed, "follow", fails)
    for second in range(3):
        feed.tick(float(second))
    common = told(feed)
    assert common["rigs"] == [{"rig": "bench", "life": "live"}]
    (notice,) = common["notices"]
    assert "showing a rig goes on after a failure: ZeroDivisionError" in notice["text"]


def test_nonsense_on_a_rigs_keys_is_reported_now_and_then() -> None:
    client = FakeClient(RUNNING)
    feed = Feed(client)
    feed.tick(0.0)
    for count, at in ((1, 1.0), (400, 2.0), (900, 3.0), (900, 2.0 + REFUSED_S)):
        client.become("bench", refused=count, refusal="samples that cannot be")
        feed.tick(at)
    texts = [notice["text"] for notice in told(feed)["notices"]]
    assert texts == [
        "bench: 1 messages refused, the last: samples that cannot be",
        "bench: 899 messages refused, the last: samples that cannot be",
    ]


def test_that_no_rig_is_heard_tells_nothing_before_the_console_has_listened_for_a_while() -> None:
    feed = Feed(FakeClient(RUNNING))
    for at, listening in (
        (None, True),
        (7.0, True),
        (6.9 + LISTENS_S, True),
        (7.0 + LISTENS_S, False),
    ):
        if at is not None:
            feed.tick(at)
        assert told(feed)["listening"] == listening


def test_what_was_measured_before_a_session_is_not_taken_again_while_it_only_connects() -> None:
    client = FakeClient(RUNNING)
    feed = RigFeed("bench")
    feed.follow(client, client.snapshot("bench"), 0.0)
    assert feed.history is not None
    count, newest_s = feed.curves.count, feed.history.newest_s
    client.become("bench", session="s2", rate_hz=0.0)
    for tick in range(1, 60):
        feed.follow(client, client.snapshot("bench"), 0.1 * tick)
    assert (feed.curves.count, feed.history.newest_s) == (count, newest_s)
    client.become("bench", rate_hz=1000.0)
    feed.follow(client, client.snapshot("bench"), 6.1)
    assert feed.curves.epoch > 0
    assert feed.history.newest_s > newest_s
