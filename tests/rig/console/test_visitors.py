"""Whoever has not the token stays outside; of those inside, one operator at a time has control."""

import json
import os
from hashlib import sha256
from pathlib import Path

import pytest

from rig.console.logins import LONGEST_NAME, LoginFile
from rig.console.visitors import (
    FAILURES,
    FAILURES_S,
    LIFETIME_S,
    MOST_ADDRESSES,
    MOST_VISITORS,
    ControlHolder,
    LoginRefused,
    NotInControl,
    Visitor,
    Visitors,
    console_token,
)

TOKEN = "ab" * 32


class Clock:
    """A clock that stands still unless it is moved."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def visitors(clock: Clock) -> Visitors:
    return Visitors(TOKEN, clock)


def fail(visitors: Visitors, address: str = "a", token: str = "wrong") -> str:
    with pytest.raises(LoginRefused) as refused:
        visitors.log_in(token, "Eve", address)
    return str(refused.value)


def test_the_token_lets_in_and_its_cookie_tells_who_it_is(visitors: Visitors) -> None:
    cookie = visitors.log_in(f" {TOKEN}\n", "  Anna\tMeier ", "a")
    visitor = visitors.visitor(cookie)
    assert visitor is not None
    assert (visitor.name, visitor.number) == ("Anna Meier", 1)
    assert TOKEN not in cookie


@pytest.mark.parametrize("token", ["", "wrong", TOKEN[:-1], TOKEN + "0", TOKEN.upper(), "\ud800"])
def test_another_token_is_refused(visitors: Visitors, token: str) -> None:
    assert fail(visitors, token=token) == "this is not the token"


@pytest.mark.parametrize("cookie", [None, "", "guess"])
def test_nobody_is_known_by_another_cookie(visitors: Visitors, cookie: str | None) -> None:
    visitors.log_in(TOKEN, "Anna", "a")
    assert visitors.visitor(cookie) is None


def test_who_guesses_has_to_wait_and_locks_nobody_out(visitors: Visitors, clock: Clock) -> None:
    for _ in range(FAILURES):
        assert fail(visitors) == "this is not the token"
    assert "wait 60 s" in fail(visitors)
    assert fail(visitors, address="elsewhere") == "this is not the token"
    assert visitors.visitor(visitors.log_in(TOKEN, "Anna", "a"))
    clock.now += FAILURES_S + 1.0
    assert fail(visitors) == "this is not the token"


def test_guessing_from_everywhere_takes_no_more_memory(visitors: Visitors) -> None:
    for number in range(MOST_ADDRESSES + 50):
        fail(visitors, address=str(number))
    assert len(visitors._failures) == MOST_ADDRESSES


def test_a_shift_later_one_has_to_log_in_anew(visitors: Visitors, clock: Clock) -> None:
    cookie = visitors.log_in(TOKEN, "Anna", "a")
    clock.now += LIFETIME_S + 1.0
    assert visitors.visitor(cookie) is None


def test_who_logs_out_is_not_known_any_more(visitors: Visitors) -> None:
    cookie = visitors.log_in(TOKEN, "Anna", "a")
    visitors.log_out(cookie)
    visitors.log_out(None)
    assert visitors.visitor(cookie) is None


@pytest.mark.parametrize("name", ["", " \n ", "x" * (LONGEST_NAME + 1)])
def test_a_name_is_needed(visitors: Visitors, name: str) -> None:
    with pytest.raises(LoginRefused, match="give a name"):
        visitors.log_in(TOKEN, name, "a")


def test_the_first_of_too_many_visitors_is_forgotten(visitors: Visitors) -> None:
    first, *_, last = [visitors.log_in(TOKEN, "x", "a") for _ in range(MOST_VISITORS + 1)]
    assert visitors.visitor(first) is None
    assert visitors.visitor(last)


def test_the_token_is_kept_where_only_its_user_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    token, path = console_token()
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(token) == 64
    assert console_token() == (token, path)


def kept(folder: Path, clock: Clock, token: str = TOKEN) -> Visitors:
    """Return the visitors of a console that keeps its logins in a folder."""
    digest = sha256(token.encode()).hexdigest()
    return Visitors(token, clock, LoginFile(folder / "logins.json", digest, clock))


def test_a_login_outlives_a_restart_of_the_console_with_its_number_and_no_longer_than_its_time(
    clock: Clock, tmp_path: Path
) -> None:
    first = kept(tmp_path, clock)
    anna, ben = first.log_in(TOKEN, "Anna", "a"), first.log_in(TOKEN, "Ben", "a")
    first.log_out(ben)
    clock.now += 60.0
    again = kept(tmp_path, clock)
    assert again.visitor(anna) == first.visitor(anna)
    assert again.visitor(ben) is None
    assert again.visitor(again.log_in(TOKEN, "Eva", "a")) == Visitor(
        2, "Eva", clock.now + LIFETIME_S
    )
    clock.now += LIFETIME_S - 59.0
    assert kept(tmp_path, clock).visitor(anna) is None


def test_the_file_of_logins_lets_nobody_in_and_a_new_token_ends_them(
    clock: Clock, tmp_path: Path
) -> None:
    cookie = kept(tmp_path, clock).log_in(TOKEN, "Anna", "a")
    file = tmp_path / "logins.json"
    assert cookie not in file.read_text()
    assert file.stat().st_mode & 0o077 == 0
    assert kept(tmp_path, clock, "cd" * 32).visitor(cookie) is None


@pytest.mark.parametrize("text", ["", "[]", "{", "{}", '{"token": 1, "logins": [1]}', "\x00"])
def test_a_damaged_file_of_logins_holds_none(clock: Clock, tmp_path: Path, text: str) -> None:
    (tmp_path / "logins.json").write_text(text)
    visitors = kept(tmp_path, clock)
    assert visitors.visitor(visitors.log_in(TOKEN, "Anna", "a")) is not None


ANNA, BEN = Visitor(1, "Anna", 9.9), Visitor(2, "Ben", 9.9)


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def control(told: list[str]) -> ControlHolder:
    return ControlHolder(told.append, lambda: 5_000_000)


def test_nobody_may_act_before_taking_control(control: ControlHolder) -> None:
    with pytest.raises(NotInControl, match="nobody has control"):
        control.require(ANNA)
    control.take(ANNA)
    control.require(ANNA)


def test_who_has_control_keeps_it_until_it_is_taken_over(
    control: ControlHolder, told: list[str]
) -> None:
    control.take(ANNA)
    control.take(ANNA)
    with pytest.raises(NotInControl, match="Anna has control"):
        control.take(BEN)
    with pytest.raises(NotInControl, match="Anna has control"):
        control.require(BEN)
    control.take(BEN, over=True)
    with pytest.raises(NotInControl, match="Ben has control"):
        control.require(ANNA)
    assert told == ["Anna takes control", "Ben takes over from Anna"]
    assert control.content() == {"number": 2, "name": "Ben", "since_ms": 5}


def test_control_is_given_up_by_who_has_it_only(control: ControlHolder, told: list[str]) -> None:
    control.take(ANNA)
    control.release(BEN)
    control.require(ANNA)
    control.release(ANNA)
    assert control.content()["number"] is None
    assert told[-1] == "Anna gives control up"


def test_a_pipe_in_place_of_the_file_of_logins_is_passed_over(clock: Clock, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "logins.json")
    visitors = kept(tmp_path, clock)
    assert visitors.visitor(visitors.log_in(TOKEN, "Anna", "a")) is not None


def changed_login(folder: Path, clock: Clock, key: str, value: object) -> str:
    """Log Anna in, change her login in the file, and return her cookie."""
    cookie = kept(folder, clock).log_in(TOKEN, "Anna", "a")
    file = folder / "logins.json"
    content = json.loads(file.read_text())
    content["logins"][0][key] = value
    file.write_text(json.dumps(content))
    return cookie


def test_no_login_of_the_file_lasts_longer_than_a_login_over_any_number_of_restarts(
    clock: Clock, tmp_path: Path
) -> None:
    cookie = changed_login(tmp_path, clock, "until_s", 1e300)
    assert kept(tmp_path, clock).visitor(cookie) is not None
    clock.now += LIFETIME_S - 1.0
    assert kept(tmp_path, clock).visitor(cookie) is not None
    clock.now += 2.0
    assert kept(tmp_path, clock).visitor(cookie) is None


@pytest.mark.parametrize(
    ("key", "value"),
    [("name", "x" * 5000), ("name", ""), ("until_s", 10**400), ("until_s", float("nan"))],
)
def test_a_login_of_the_file_that_no_console_made_is_left_out(
    clock: Clock, tmp_path: Path, key: str, value: object
) -> None:
    cookie = changed_login(tmp_path, clock, key, value)
    assert kept(tmp_path, clock).visitor(cookie) is None


@pytest.mark.parametrize("mode", [0o666, 0o620])
def test_a_file_of_logins_that_others_may_write_holds_none(
    clock: Clock, tmp_path: Path, mode: int
) -> None:
    cookie = kept(tmp_path, clock).log_in(TOKEN, "Anna", "a")
    (tmp_path / "logins.json").chmod(mode)
    assert kept(tmp_path, clock).visitor(cookie) is None


def test_a_file_of_logins_of_another_user_holds_none(
    clock: Clock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cookie = kept(tmp_path, clock).log_in(TOKEN, "Anna", "a")
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert kept(tmp_path, clock).visitor(cookie) is None


def test_who_logs_in_twice_takes_control_from_nobody_else() -> None:
    said: list[str] = []
    control = ControlHolder(said.append)
    for number, name, over in ((1, "Ada", False), (2, "Ada", True), (3, "Bo", True)):
        control.take(Visitor(number, name, 9e9), over=over)
    assert said == [
        "Ada takes control", "Ada takes control on another page", "Bo takes over from Ada",
    ]  # fmt: skip
