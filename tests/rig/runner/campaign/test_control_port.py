"""The control port answers whatever it is sent, and serves the next one: a rig can be stopped."""

import errno
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from estimator.leaks.detection import Decision
from faults.campaign import Campaign, CampaignTest
from rig.configuration.rigs.rig import Rig
from rig.control_socket import LONGEST_LINE, SOCKET, ControlError, address_of, ask
from rig.recording import read_recording
from rig.report import write_report
from rig.runner import Observer, run_campaign
from rig.runner.campaign.control_port import MOST_CLIENTS, ControlPort
from rig.runner.campaign.operator_requests import LONGEST_TEST, Desk, RefusedError, Request
from rig.runner.campaign.stopping import StopFlag
from rig.runner.run_folder.journal import JOURNAL, Journal, read_journal
from tests.waiting import PATIENCE_S

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class Served:
    """A campaign's desk at a port, with its journal on disk."""

    def __init__(self, folder: Path, tests: int = 2) -> None:
        self.folder = folder
        self.refused: list[str] = []
        self.stop = StopFlag()
        self.desk = Desk()
        self.names = [f"test {number}" for number in range(tests)]
        self.write: Callable[..., object] = lambda kind, **told: None

    def __enter__(self) -> "Served":
        self.journal = Journal(self.folder)
        self.journal.__enter__()
        self.write = self.journal.write
        self.desk.open(self.names, {}, lambda kind, **told: self.write(kind, **told), self.stop)
        self.port = ControlPort(self.folder, self.desk, self.refused.append)
        self.port.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.port.__exit__()
        self.journal.__exit__()

    def send(self, line: bytes) -> dict[str, Any]:
        """Send any bytes, say that there are no more, and return the answer."""
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(30.0)
            with address_of(self.folder) as address:
                client.connect(address)
            try:
                client.sendall(line)
                client.shutdown(socket.SHUT_WR)
            except OSError:  # it is refused before it was heard to its end
                pass
            return json.loads(client.makefile("rb").readline())

    def serves(self) -> bool:
        return ask(self.folder, Request.STATUS)["status"]["tests"] == len(self.names)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with Served(tmp_path) as served:
        yield served


def request(**content: Any) -> bytes:
    return json.dumps(content).encode() + b"\n"


MALFORMED = {
    "not UTF-8": (b'{"request": "note", "text": "caf\xe9"}\n', "no UTF-8"),
    "half a character": (request(request="note", text="caf\udce9"), "no UTF-8"),
    "half a character in a name": (request(request="skip", test="\ud800"), "no UTF-8"),
    "not JSON": (b"abort\n", "no JSON"),
    "two requests": (2 * request(request="pause"), "no JSON"),
    "a list": (b'["abort"]\n', "keys"),
    "a key twice": (b'{"request": "note", "request": "abort"}\n', "the key 'request' twice"),
    "another key": (request(request="abort", sudo="yes"), "keys"),
    "a number for a text": (request(request="note", text=7), "no text"),
    "infinity": (b'{"request": "note", "text": 1e999}\n', "no text"),
    "a number of a thousand digits": (b'{"request": ' + b"9" * 5000 + b"}\n", "no JSON"),
    "endless nesting": (b"[" * 10_000 + b"\n", "no JSON"),
    "endless nesting of a text": (b'{"text": ' + b"[" * 5000 + b"\n", "no JSON"),
    "too long": (request(request="note", text="x" * LONGEST_LINE), "too long"),
    "half a line": (b'{"request": "no', "does not end"),
    "nothing": (b"", "does not end"),
    "a long text": (request(request="note", text="x" * 2000), "at most"),
    "a long name": (request(request="skip", test="x" * (LONGEST_TEST + 1)), "at most"),
    "no request": (b"{}\n", "nothing that there is"),
    "an unknown one": (request(request="format"), "nothing that there is"),
}


@pytest.mark.parametrize("kind", MALFORMED)
def test_a_malformed_request_is_answered_with_what_is_wrong_and_the_next_one_served(
    served: Served, kind: str
) -> None:
    line, why = MALFORMED[kind]
    answer = served.send(line)
    assert not answer["ok"]
    assert why in answer["problem"]
    assert served.refused == [answer["problem"]]
    assert served.serves()
    assert ask(served.folder, Request.ABORT)["reply"].startswith("is stopped")
    assert served.stop.requested


ANYTHING = st.text(st.characters(exclude_categories=[]), max_size=9)
LINES = st.one_of(
    st.binary(max_size=200),
    st.text(max_size=100).map(str.encode),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
        max_leaves=6,
    ).map(lambda content: json.dumps(content).encode()),
    st.fixed_dictionaries(
        {"request": st.sampled_from([*map(str, Request), "x"])},
        optional={"text": ANYTHING, "test": ANYTHING},
    ).map(lambda content: json.dumps(content).encode()),
)  # fmt: skip


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(b'{"request": "note", "text": "\\ud83d"}')
@example(b'{"request": "note", "text": "\\u0000\\u2028\\u001b[2J"}')
@given(LINES)
def test_whatever_is_sent_is_answered_and_leaves_a_journal_that_can_be_read(
    served: Served, line: bytes
) -> None:
    answer = served.send(line + b"\n")
    assert isinstance(answer["ok"], bool)
    assert answer["ok"] or answer["problem"]
    assert "it failed" not in answer.get("problem", "")
    assert served.serves()
    read_journal(served.folder / JOURNAL)


def test_a_note_is_kept_on_one_line_without_control_characters(served: Served) -> None:
    assert ask(served.folder, Request.NOTE, "oil\n\x1b[2Jdrips\x00")["reply"] == "noted"
    (entry,) = read_journal(served.folder / JOURNAL)
    assert entry["text"] == "oil  [2Jdrips "


def test_a_request_that_fails_is_answered_and_the_next_one_served(served: Served) -> None:
    def fails(kind: str, **told: object) -> None:
        raise ZeroDivisionError("of the program")

    write, served.write = served.write, fails
    with pytest.raises(ControlError, match="it failed: ZeroDivisionError: of the program"):
        ask(served.folder, Request.NOTE, "now")
    served.write = write
    assert ask(served.folder, Request.NOTE, "now")["reply"] == "noted"


def test_a_full_disk_refuses_a_note_but_no_abort(served: Served) -> None:
    def full(kind: str, **told: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    served.write = full
    with pytest.raises(ControlError, match=r"the journal cannot be written: .*No space left"):
        ask(served.folder, Request.NOTE, "now")
    reply = ask(served.folder, Request.ABORT)["reply"]
    assert "is stopped" in reply
    assert "the journal cannot be written" in reply
    assert served.stop.requested


def test_refusals_that_cannot_be_kept_are_answered_all_the_same(tmp_path: Path) -> None:
    def full(why: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with Served(tmp_path) as served:
        served.port._refused = full
        assert not served.send(b"nonsense\n")["ok"]
        assert served.serves()


def connected(folder: Path) -> socket.socket:
    """A client that has connected and says nothing."""
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(30.0)
    with address_of(folder) as address:
        client.connect(address)
    return client


def test_no_client_waits_for_those_that_are_silent(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.runner.campaign.control_port.PATIENCE_S", PATIENCE_S)
    with ExitStack() as clients:
        for _ in range(MOST_CLIENTS - 1):
            clients.enter_context(connected(served.folder))
        # Were it served after one of them, it would wait for all of its own patience in vain.
        assert served.serves()
        assert ask(served.folder, Request.ABORT)["reply"].startswith("is stopped")
    assert served.stop.requested


def test_where_all_places_are_taken_by_silent_clients_the_oldest_is_refused(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.runner.campaign.control_port.PATIENCE_S", PATIENCE_S)
    with ExitStack() as clients:
        silent = [clients.enter_context(connected(served.folder)) for _ in range(MOST_CLIENTS)]
        assert served.serves()
        assert b"does not end" in silent[0].recv(4096)
        silent[1].sendall(request(request="pause"))
        assert b"pauses" in silent[1].recv(4096)


def test_who_was_silent_at_the_end_of_the_campaign_does_not_prolong_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.runner.campaign.control_port.PATIENCE_S", PATIENCE_S)
    with Served(tmp_path) as served:
        silent = connected(tmp_path)
        assert served.serves()
    with silent:
        assert b"does not end" in silent.recv(4096)


def test_without_a_thread_to_be_had_clients_are_served_one_after_the_other(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuses)
    assert served.serves()
    assert served.serves()


def test_the_port_is_there_again_once_there_are_descriptors(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert served.port._listener is not None
    listener: socket.socket = served.port._listener

    class Starved:
        """A listener for whose next connections there is no descriptor."""

        left = 2

        def accept(self) -> tuple[socket.socket, Any]:
            taken = listener.accept()
            if self.left:
                self.left -= 1
                taken[0].close()
                raise OSError(errno.EMFILE, "Too many open files")
            return taken

        def shutdown(self, how: int) -> None:
            listener.shutdown(how)

        def close(self) -> None:
            listener.close()

    monkeypatch.setattr(served.port, "_listener", Starved())
    # The first is still taken by the call that waits already.
    for _ in range(3):
        try:
            ask(served.folder, Request.STATUS)
        except ControlError:
            continue
    assert served.serves()
    assert any("Too many open files" in why for why in served.refused)


def test_the_status_of_a_campaign_of_thousands_of_tests_is_reported(tmp_path: Path) -> None:
    with Served(tmp_path, tests=3000) as served:
        for index in range(3000):
            served.desk.ends(index, "passed", attention=True)
        status = ask(tmp_path, Request.STATUS)["status"]
    assert len(status["ended"]) == 3000


@pytest.mark.parametrize(
    "answer", [b"\xff\n", b"[1]\n", b"7\n", b'{"ok": 0}\n', b"{}\n", b"[" * 9999 + b"\n"]
)
def test_what_is_no_answer_of_a_campaign_is_said_to_be_none(tmp_path: Path, answer: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        with address_of(tmp_path) as address:
            listener.bind(address)
        listener.listen(1)

        def replies() -> None:
            client, _ = listener.accept()
            with client:
                client.recv(LONGEST_LINE)
                client.sendall(answer)

        serving = threading.Thread(target=replies)
        serving.start()
        with pytest.raises(ControlError, match="does not answer as a campaign does"):
            ask(tmp_path, Request.STATUS)
        serving.join()
    assert (tmp_path / SOCKET).exists()


@pytest.mark.parametrize("text", ["caf\udce9", "\ud83d", "x" * 1001])
def test_the_desk_refuses_what_no_record_can_keep_however_it_came(text: str) -> None:
    desk = Desk()
    written: list[Any] = []
    desk.open(["one"], {}, lambda kind, **told: written.append(told), StopFlag())
    with pytest.raises(RefusedError):
        desk.ask(Request.NOTE, "anna", text)
    assert written == []


def test_a_journal_keeps_the_name_of_a_folder_that_is_no_utf_8(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9")
    with Journal(tmp_path) as journal:
        journal.write("begin", given={"folder": name})
    (entry,) = read_journal(tmp_path / JOURNAL)
    assert entry["given"] == {"folder": name}


def test_a_strange_note_is_in_journal_recording_results_and_report(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    text = "\u202eback, \U0001f6d1 \u0000\x1b[2J </script><b>\u2028 &amp; \ufffe"

    class Noting(Observer):
        asked = False

        def test_advances(self, time_s: float, decision: Decision | None) -> None:
            if not self.asked:
                self.asked = True
                assert ask(tmp_path, Request.NOTE, text)["reply"] == "noted"
                with pytest.raises(ControlError, match="no UTF-8"):
                    ask(tmp_path, Request.NOTE, "caf\udce9")

    campaign = make_campaign(make_test("one", duration_s=5.0))
    outcome = run_campaign(campaign, rig, tmp_path, observer=Noting())
    kept = "".join(sign if sign.isprintable() else " " for sign in text)
    notes = [
        event for event in read_recording(tmp_path / "one.mcap").events if event.kind == "note"
    ]
    assert [note.text.partition(": ")[2] for note in notes] == [kept]
    results = json.loads((tmp_path / "results.json").read_text())
    assert kept in [each["what"] for each in results["history"]]
    page = write_report(outcome, tmp_path).read_text()
    assert "&lt;/script&gt;&lt;b&gt;" in page
    assert [e["why"] for e in read_journal(tmp_path / JOURNAL) if e.kind == "refused"] == [
        "a text that is no UTF-8"
    ]
