"""Who logs in by an account may do what its role says now, for a time; then only stop."""

import asyncio
import os
import time
from pathlib import Path
from typing import Any

import pytest

from rig.accounts import AccountFile, AccountsError, Role
from rig.accounts.attempts import OF_A_NAME
from rig.console.logins import account_logins
from rig.console.members import IDLE_S, MOST_WAITING, STOPPING_S, WRONG, Members
from rig.console.visitors import LIFETIME_S, MOST_VISITORS, LoginRefused

from ..site import CHEAP
from ..test_visitors import Clock

PASSWORD = "four words that differ"
HASH = CHEAP.hash(PASSWORD)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def accounts(tmp_path: Path) -> AccountFile:
    file = AccountFile(tmp_path / "accounts.json")
    file.add("Bo", Role.OPERATOR, HASH)
    file.add("Vera", Role.VIEWER, HASH)
    return file


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def members(accounts: AccountFile, clock: Clock, said: list[str], tmp_path: Path) -> Members:
    return console(accounts, clock, said, tmp_path)


def console(accounts: AccountFile, clock: Clock, said: list[str], folder: Path) -> Members:
    logins = account_logins(folder, 1, accounts.path)
    logins._clock = clock
    return Members(accounts, said.append, CHEAP, clock, logins)


def log_in(
    members: Members,
    name: str = "Bo",
    password: str = PASSWORD,
    address: str = "a",
    cookie: str | None = None,
) -> str:
    return asyncio.run(members.log_in(name, password, address, cookie))


def fail(members: Members, **given: Any) -> str:
    with pytest.raises(LoginRefused) as refused:
        log_in(members, **{"password": "wrong", **given})
    return str(refused.value)


def role(members: Members, cookie: str | None) -> Role | None:
    """Return the role of who has a cookie; None if nobody has, or it can only stop."""
    visitor = members.visitor(cookie)
    return None if visitor is None or visitor.expired else visitor.role


def can_only_stop(members: Members, cookie: str) -> bool:
    visitor = members.visitor(cookie)
    return visitor is not None and visitor.expired


def nothing_fits(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have every password be wrong; return the list that takes each hash it is compared with."""
    compared: list[str] = []

    def fits(hashed: str, _: str) -> bool:
        compared.append(hashed)
        return False

    monkeypatch.setattr(CHEAP, "fits", fits)
    return compared


def test_name_and_password_let_in_and_the_cookie_tells_who_it_is(members: Members) -> None:
    visitor = members.visitor(log_in(members, " bO "))
    assert visitor is not None
    assert (visitor.name, visitor.role, visitor.number) == ("Bo", Role.OPERATOR, 1)


@pytest.mark.parametrize(
    ("name", "password"),
    [("Bo", "wrong"), ("Eva", PASSWORD), ("", PASSWORD), ("\ud800", "\ud800"), ("x" * 4000, "x")],
)
def test_a_wrong_name_is_told_from_a_wrong_password_by_nothing(
    members: Members, name: str, password: str
) -> None:
    assert fail(members, name=name, password=password) == WRONG


def test_a_name_without_account_costs_one_comparison_as_well(
    members: Members, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = nothing_fits(monkeypatch)
    for name in ("Bo", "Eva"):
        fail(members, name=name)
    assert compared == [HASH, CHEAP.decoy]


def test_who_guesses_waits_and_keeps_nobody_else_out(members: Members, clock: Clock) -> None:
    known = log_in(members)
    for _ in range(OF_A_NAME):
        assert fail(members) == WRONG
    assert "wait 60 s" in fail(members, password=PASSWORD)
    assert log_in(members, "Vera")
    assert log_in(members, address="b")
    # A browser from which Bo was logged in before is not kept out by guesses beside it.
    assert log_in(members, cookie=known)
    clock.now += 61.0
    assert log_in(members)


def test_two_hundred_guesses_at_once_cost_no_more_than_those_of_a_minute(
    members: Members, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = nothing_fits(monkeypatch)

    async def storm() -> list[str]:
        tries = (members.log_in("Bo", "wrong", "a", None) for _ in range(200))
        return [str(each) for each in await asyncio.gather(*tries, return_exceptions=True)]

    answers = asyncio.run(storm())
    assert len(compared) == answers.count(WRONG) == OF_A_NAME
    assert sum("too many" in each for each in answers) == 200 - OF_A_NAME


def test_few_passwords_wait_to_be_compared_wherever_they_come_from(
    members: Members, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[str] = []

    def slow(hashed: str, _: str) -> bool:
        compared.append(hashed)
        time.sleep(0.001)
        return False

    monkeypatch.setattr(CHEAP, "fits", slow)

    async def storm() -> list[str]:
        tries = (members.log_in("Bo", "wrong", f"{n}", None) for n in range(200))
        return [str(each) for each in await asyncio.gather(*tries, return_exceptions=True)]

    answers = asyncio.run(storm())
    assert len(compared) == MOST_WAITING
    assert sum("at once" in each for each in answers) == 200 - MOST_WAITING


def test_an_operator_who_rests_may_stop_and_no_more_and_a_viewer_who_looks_stays(
    members: Members, clock: Clock
) -> None:
    bo, vera = log_in(members), log_in(members, "Vera")
    clock.now += IDLE_S - 1.0
    assert members.visitor(bo, acts=True) is not None
    clock.now += IDLE_S - 1.0
    assert role(members, bo) == Role.OPERATOR
    clock.now += 2.0
    assert can_only_stop(members, bo)
    assert members.visitor(bo, acts=True) is not None
    assert can_only_stop(members, bo)
    assert role(members, vera) == Role.VIEWER


def test_a_shift_later_everybody_may_stop_and_no_more_and_a_week_later_nothing(
    members: Members, clock: Clock
) -> None:
    vera = log_in(members, "Vera")
    clock.now += LIFETIME_S + 1.0
    assert can_only_stop(members, vera)
    clock.now += STOPPING_S
    assert members.visitor(vera) is None


def test_logins_outlive_a_restart_with_role_rest_and_end(
    members: Members, accounts: AccountFile, clock: Clock, said: list[str], tmp_path: Path
) -> None:
    bo, vera = log_in(members), log_in(members, "Vera")
    clock.now += 60.0
    again = console(accounts, clock, said, tmp_path)
    assert again.visitor(bo) == members.visitor(bo)
    assert role(again, bo) == Role.OPERATOR
    clock.now += IDLE_S - 30.0
    rested = console(accounts, clock, said, tmp_path)
    assert can_only_stop(rested, bo)
    assert role(rested, vera) == Role.VIEWER
    clock.now += LIFETIME_S
    assert can_only_stop(console(accounts, clock, said, tmp_path), vera)
    clock.now += STOPPING_S
    assert console(accounts, clock, said, tmp_path).visitor(vera) is None
    assert PASSWORD not in (tmp_path / "console-account-logins-1.json").read_text()
    assert bo not in (tmp_path / "console-account-logins-1.json").read_text()


def test_removal_password_and_role_hold_at_once_also_over_a_restart(
    members: Members, accounts: AccountFile, clock: Clock, said: list[str], tmp_path: Path
) -> None:
    bo, vera = log_in(members), log_in(members, "Vera")
    accounts.change("Vera", role=Role.ENGINEER)
    members.look()
    assert role(members, vera) == Role.ENGINEER
    assert members.may_act(2)
    accounts.change("Vera", role=Role.VIEWER)
    accounts.change("Bo", password=CHEAP.hash("another password"))
    members.look()
    assert role(members, vera) == Role.VIEWER
    assert not members.may_act(2)
    assert members.visitor(bo) is None
    accounts.remove("Vera")
    accounts.add("Vera", Role.ENGINEER, CHEAP.hash(PASSWORD))
    members.look()
    assert members.visitor(vera) is None
    assert console(accounts, clock, said, tmp_path).visitor(vera) is None
    assert said == []


@pytest.mark.parametrize("how", ["gone", "damaged", "open"])
def test_while_the_file_cannot_be_used_everybody_may_stop_and_no_more(
    members: Members, accounts: AccountFile, said: list[str], how: str
) -> None:
    bo, content = log_in(members), accounts.path.read_text()
    if how == "gone":
        accounts.path.unlink()
    elif how == "damaged":
        accounts.path.write_text(content[:-9])
    else:
        accounts.path.chmod(0o644)
    members.look()
    members.look()
    assert can_only_stop(members, bo)
    assert "cannot be used" in fail(members, password=PASSWORD)
    accounts.path.unlink(missing_ok=True)
    accounts.path.write_text(content)
    accounts.path.chmod(0o600)
    members.look()
    assert role(members, bo) == Role.OPERATOR
    assert [text.split(";")[-1] for text in said] == [
        " until it is mended nobody may do anything but stop",
        "accounts: the file can be used again",
    ]


def test_a_disk_that_fails_changes_no_account_and_is_told_once(
    members: Members, accounts: AccountFile, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bo = log_in(members)
    accounts.change("Bo", role=Role.VIEWER)

    def fails(*_: object) -> int:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", fails)
        members.look()
        members.look()
    assert role(members, bo) == Role.OPERATOR
    assert len(said) == 1
    members.look()
    assert role(members, bo) == Role.VIEWER


def test_a_console_without_any_account_does_not_begin(tmp_path: Path, clock: Clock) -> None:
    accounts = AccountFile(tmp_path / "accounts.json")
    with pytest.raises(AccountsError, match="make it by rig accounts add"):
        Members(accounts, print, CHEAP, clock)
    accounts.add("Bo", Role.VIEWER, HASH)
    accounts.remove("Bo")
    with pytest.raises(AccountsError, match="holds no account; add one"):
        Members(accounts, print, CHEAP, clock)


def test_the_oldest_of_too_many_logins_ends_and_who_logs_out_is_gone(members: Members) -> None:
    first, second, *_ = [log_in(members) for _ in range(MOST_VISITORS + 1)]
    assert members.visitor(first) is None
    members.log_out(second)
    members.log_out(None)
    assert members.visitor(second) is None
