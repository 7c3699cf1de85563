"""At a console with accounts the server asks for the role, whatever the page says."""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from rig.accounts import AccountFile, Role
from rig.cli.live_stream import obeyed_by
from rig.console.launcher import Launcher, Offer, Served
from rig.console.orders import ORDERS, Order, Orders
from rig.console.visitors import ControlHolder, Visitor
from rig.runner.campaign import Desk, StopFlag
from rig.runner.campaign.control_port import ControlPort
from rig.runner.run_folder import JOURNAL, Journal, read_journal
from rig.stream.answers import Answer
from rig.stream.commands import Credentials, Gate, Sender
from rig.stream.settings import COMMANDS

from ..fakes import RUNNING, FakeClient, start_by, until
from ..site import CHEAP, TOKEN, Headers, Site, site_served

PASSWORD = "four words that differ"
HASH = CHEAP.hash(PASSWORD)


@pytest.fixture(scope="module")
def served(leaving: ExitStack, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    file = AccountFile(tmp_path_factory.mktemp("accounts") / "accounts.json")
    for name, role in (("Vera", Role.VIEWER), ("Bo", Role.OPERATOR), ("Eng", Role.ENGINEER)):
        file.add(name, role, HASH)
    with site_served(leaving, accounts=file) as site:
        yield site


@pytest.fixture
def site(served: Site) -> Site:
    served.client.sent.clear()
    served.client.persons.clear()
    return served


def cookie(site: Site, name: str) -> Headers:
    reply = site.member(name, PASSWORD)
    assert reply.status == 303, reply.text
    return {"Cookie": reply.headers["set-cookie"].partition(";")[0]}


def accounts_of(site: Site) -> AccountFile:
    assert site.console.accounts is not None
    return site.console.accounts


def changed(site: Site, change: Callable[[AccountFile], Any]) -> None:
    """Change the accounts, and have the console see that now."""
    assert site.console.members is not None
    change(accounts_of(site))
    site.console.members.look()


def first_of(socket: ClientConnection, *keys: str) -> list[Any]:
    """Return values of the next message of a live view that has all of some keys."""
    while True:
        told = json.loads(socket.recv(timeout=30))
        if set(keys) <= told.keys():
            return [told[key] for key in keys]


def test_one_logs_in_by_name_and_password_and_the_token_is_no_key(site: Site) -> None:
    form = site.ask("GET", "/login").text
    assert ("Password" in form, "Token" in form) == (True, False)
    assert site.log_in(token=TOKEN).status == 403
    wrong = site.member("Bo", "wrong" + "<b>")
    assert (wrong.status, "name or password is wrong" in wrong.text) == (403, True)
    assert "<b>" not in wrong.text
    right = site.member("bo", PASSWORD)
    assert right.status == 303
    assert "HttpOnly" in right.headers["set-cookie"]
    assert "SameSite=strict" in right.headers["set-cookie"]
    assert not any(PASSWORD in line or "wrong<b>" in line for line in site.log)


def test_what_a_role_may_not_do_is_refused_with_the_role_that_is_needed(site: Site) -> None:
    vera, bo = cookie(site, "Vera"), cookie(site, "Bo")
    for order in ORDERS:
        if order != "stop":
            status, answer = site.order(vera, order=order, rig="bench", name="out", text="x")
            assert (status, "yours is viewer" in answer["reason"]) == (403, True), order
    status, answer = site.order(bo, order="set", name="out", text="gain=80V/m")
    assert (status, answer["reason"]) == (403, "this needs the role engineer; yours is operator")
    assert site.client.sent == []
    assert site.is_logged("Vera: hold: this needs the role operator")
    assert site.order(vera, order="stop", rig="bench")[0] == 200
    assert site.client.persons == ["Vera"]


def test_the_page_is_told_its_role_and_at_once_when_it_changes(site: Site) -> None:
    vera = cookie(site, "Vera")
    with site.live(vera) as socket:
        name, role, may_not = first_of(socket, "name", "role", "may_not")
        assert (name, role, "hold" in may_not, "stop" in may_not) == ("Vera", "viewer", True, False)
        changed(site, lambda file: file.change("Vera", role=Role.OPERATOR))
        assert first_of(socket, "role") == ["operator"]
        assert site.order(vera, order="take over")[0] == 200
        changed(site, lambda file: file.change("Vera", role=Role.VIEWER))
        assert first_of(socket, "role") == ["viewer"]
        until(lambda: site.console.control.holder is None, "control to be given up")
    assert site.order(vera, order="hold", rig="bench")[0] == 403


def test_who_is_removed_is_out_at_once_with_page_and_control(site: Site) -> None:
    changed(site, lambda file: file.add("Rem", Role.ENGINEER, HASH))
    rem = cookie(site, "Rem")
    assert site.order(rem, order="take over")[0] == 200
    with site.live(rem) as socket:
        changed(site, lambda file: file.remove("Rem"))
        with pytest.raises(ConnectionClosed) as closed:
            first_of(socket, "nothing")
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4401
    assert site.order(rem, order="stop", rig="bench")[0] == 401
    until(lambda: site.console.control.holder is None, "control to be given up")


def test_an_expired_login_may_stop_and_nothing_else_and_says_so(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    bo = cookie(site, "Bo")
    assert site.order(bo, order="take over")[0] == 200
    assert site.console.members is not None
    clock = site.console.members._clock
    with site.live(bo) as socket:
        monkeypatch.setattr(site.console.members, "_clock", lambda: clock() + 13 * 3600.0)
        with pytest.raises(ConnectionClosed) as closed:
            first_of(socket, "nothing")
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4402
    status, answer = site.order(bo, order="hold", rig="bench")
    assert (status, answer["expired"], "Stop works" in answer["reason"]) == (401, True, True)
    assert site.order(bo, order="stop", rig="bench", text="oil")[0] == 200
    assert site.client.sent == [("abort", "bench", "Bo: by a login that has expired; oil", "")]
    # The page with its stop can still be had, and the login beside it.
    assert site.ask("GET", "/", headers=bo).status == 200
    assert site.ask("GET", "/login", headers=bo).status == 200
    until(lambda: site.console.control.holder is None, "control to be given up")


@pytest.mark.parametrize("forged", ["guess", "", "x" * 3000, "Bo"])
def test_a_forged_cookie_is_nobody(site: Site, forged: str) -> None:
    who = {"Cookie": f"{site.console.cookie}={forged}"}
    assert site.order(who, order="stop", rig="bench")[0] == 401
    assert site.client.sent == []


# -- the journal names who did it ------------------------------------------------------------------


def a_control(taken: list[str]) -> Any:
    """Return the control of a running test that takes every change, and keeps who asked for it."""

    def asked(who: str, text: str) -> tuple[str, str]:
        return f"{who}: {text}", "it is set"

    return SimpleNamespace(asked=asked, add=taken.append)


class JournalledClient(FakeClient):
    """A client whose commands are signed, checked, and obeyed by a desk that keeps a journal."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(RUNNING)
        key = Credentials("console", bytes(32))
        self.sender = Sender(key)
        self.gate = Gate("bench", "s1", {"console": (key, frozenset(COMMANDS))})
        self.obey = obeyed_by(desk)

    def send(
        self,
        command: str,
        rig: str | None = None,
        text: str = "",
        timeout_s: float = 5.0,
        test: str = "",
        person: str = "",
    ) -> Answer:
        payload = self.sender.sign("bench", "s1", command, text, test, person)
        why = self.obey(self.gate.judge(command, payload))
        return Answer(not why, why)


def test_the_journal_names_who_held_resumed_skipped_noted_acknowledged_and_stopped(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    names = {"Åsa": Role.OPERATOR, "Eng": Role.ENGINEER}
    people = [Visitor(number, name, 9e9, role) for number, (name, role) in enumerate(names.items())]
    desk, control = Desk(), ControlHolder(lambda text: None)
    launcher = Launcher(Served((), tmp_path, "loopback"), lambda text: None)
    with Journal(folder) as journal:
        desk.open(["first", "second"], {}, journal.write, StopFlag())
        desk.begins(0, a_control([]))
        orders = Orders(JournalledClient(desk), control, launcher)
        given = ("hold", "resume", "retry", "skip", "note", "acknowledge", "stop", "abort")
        for number, order in enumerate(given):
            person = people[number % 2]
            control.take(person, over=True)
            told = {"name": "first"} if order in ("retry", "skip") else {}
            assert orders.carry_out(Order(order, "bench", "oil", **told), person).accepted
    asked = [entry for entry in read_journal(folder / JOURNAL) if entry.kind == "operator"]
    requests = ["pause", *given[1:6], "abort", "abort"]
    assert [(entry["request"], entry["person"], entry["text"]) for entry in asked] == [
        (request, people[number % 2].name, f"{people[number % 2].name}: oil")
        for number, request in enumerate(requests)
    ]


def test_control_is_set_in_a_run_of_this_console_and_its_journal_names_who_did_it(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    eng, desk, control = Visitor(1, "Eng", 9e9), Desk(), ControlHolder(lambda text: None)
    launcher = Launcher(Served((), tmp_path, "loopback"), lambda text: None)
    orders = Orders(FakeClient(RUNNING), control, launcher)
    control.take(eng)
    taken: list[str] = []
    with Journal(folder) as journal, ControlPort(folder, desk, lambda why: None):
        desk.open(["first"], {}, journal.write, StopFlag())
        early = orders.carry_out(Order("set", name="out", text="gain=80V/m"), eng)
        assert not early.accepted
        desk.begins(0, a_control(taken))
        assert orders.carry_out(Order("set", name="out", text="gain=80V/m"), eng).accepted
        for name in ("", "..", "../out", str(folder), "other"):
            refused = orders.carry_out(Order("set", name=name, text="gain=80V/m"), eng)
            assert "this console's folder" in refused.reason
    gone = orders.carry_out(Order("set", name="out", text="gain=80V/m"), eng)
    assert "no campaign is running" in gone.reason
    assert taken == ["Eng: gain=80V/m"]
    (entry,) = read_journal(folder / JOURNAL)
    assert (entry["request"], entry["person"], entry["text"]) == ("set", "Eng", "gain=80V/m")


def test_an_end_that_is_acknowledged_has_its_account_s_name_in_the_journal(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    with Journal(folder) as journal:
        journal.write("begin", campaign="leaks", tests=["first"])
        journal.write("end", exit_code=3, reason="a trip")
    bo, control = Visitor(1, "Bo", 9e9, Role.OPERATOR), ControlHolder(lambda text: None)
    launcher = Launcher(Served((), tmp_path, "loopback"), lambda text: None)
    control.take(bo)
    orders = Orders(FakeClient(RUNNING), control, launcher)
    answer = orders.carry_out(Order("acknowledge", name="out", text="it was me"), bo)
    assert answer.accepted, answer.reason
    entry = read_journal(folder / JOURNAL)[-1]
    assert (entry["request"], entry["person"]) == ("acknowledge", "Bo")


@pytest.mark.parametrize("order", ["start", "go on"])
def test_whoever_starts_a_run_or_goes_on_with_it_is_named_to_it(
    tmp_path: Path, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    with Journal(tmp_path / "out") as journal:
        journal.write("begin", campaign="leaks", tests=["first"])
    commands: list[list[str]] = []
    start_by(monkeypatch, lambda command, **_: commands.append(command))
    offers = (Offer("leaks", "leaks", "", "other", 1),)
    launcher = Launcher(Served(offers, tmp_path, "loopback"), lambda text: None)
    client, control = FakeClient(RUNNING), ControlHolder(lambda text: None)
    client.become("bench", alive=False)
    bo = Visitor(1, "-Bo", 9e9, Role.OPERATOR)
    control.take(bo)
    name = "leaks" if order == "start" else "out"
    assert Orders(client, control, launcher).carry_out(Order(order, name=name), bo).accepted
    # How the run keeps `--by` in its journal is proven where that is done.
    assert "--by=-Bo" in commands[0]
