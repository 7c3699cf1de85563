"""A reader of invented names without end keeps a bounded number, and forgets no rig that lives."""

import pytest

from rig.stream.heard_rigs import MOST_RIGS, HeardRigs
from rig.stream.messages import MessageError

S = 10**9
HEARTBEAT = {"version": 1, "sequence": 0, "sent_ns": 1, "heartbeat_s": 0.5, "sequences": {}}


@pytest.fixture
def rigs() -> HeardRigs:
    return HeardRigs(30.0)


def hears(rigs: HeardRigs, rig: str, at_ns: int, *, proven: bool = False) -> None:
    content = {**HEARTBEAT, "session": rig}
    view = rigs.of(rig, at_ns, is_proven=proven)
    view.admit(content, at_ns, is_proven=proven)
    view.take("heartbeat", content, at_ns)


def ids(rigs: HeardRigs) -> set[str]:
    return {view.rig for view in rigs}


def test_of_rigs_without_end_a_bounded_number_is_kept_and_the_longest_silent_forgotten(
    rigs: HeardRigs,
) -> None:
    hears(rigs, "bench", 0)
    for number in range(3 * MOST_RIGS):
        hears(rigs, "bench", number * S)
        hears(rigs, f"invented{number}", number * S)
    newest = {f"invented{number}" for number in range(2 * MOST_RIGS + 1, 3 * MOST_RIGS)}
    assert ids(rigs) == {"bench", *newest}


def test_a_rig_that_lives_is_not_forgotten_for_one_that_proves_nothing(rigs: HeardRigs) -> None:
    living = {f"rig{number}" for number in range(MOST_RIGS)}
    for rig in living:
        hears(rigs, rig, S)
    with pytest.raises(MessageError, match=f"invented: is heard beside {MOST_RIGS} others"):
        rigs.of("invented", S + 1)
    assert ids(rigs) == living
    assert rigs.of("rig0", S + 1).heard_ns == S


def test_a_proven_rig_is_heard_beside_any_number_of_invented_ones_and_never_forgotten_for_them(
    rigs: HeardRigs,
) -> None:
    for number in range(MOST_RIGS):
        hears(rigs, f"invented{number}", S)
    hears(rigs, "mine", S, proven=True)
    assert len(ids(rigs)) == MOST_RIGS
    for number in range(2 * MOST_RIGS):
        hears(rigs, f"later{number}", (100 + number) * S)
    assert "mine" in ids(rigs)
