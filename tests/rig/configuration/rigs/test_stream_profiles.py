"""A stream's profile says who may read and command; one that is open to the world is refused."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from rig.configuration.checking import check
from rig.configuration.rigs.stream import load_stream
from rig.stream.settings import COMMANDS, Endpoint, Operator, StreamSettings

TLS = "tls: {authority: a.pem, certificate: c.pem, private_key: k.pem}\n"
LOGIN = "login: {user: rig, password_file: p, users: u}\n"
ACCESS = "access: {readers: [reader]}\n"


def profile(folder: Path, text: str) -> StreamSettings:
    path = folder / "mine.yaml"
    path.write_text(f"name: mine\n{text}")
    return load_stream(path)


def problems(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as error:
        profile(folder, text)
    return str(error.value)


def test_without_a_word_a_stream_is_on_loopback_and_takes_no_command(tmp_path: Path) -> None:
    settings = profile(tmp_path, "")
    assert settings.listen == (Endpoint("tcp", "127.0.0.1", 7447),)
    assert settings.is_local
    assert settings.operators == ()


def test_the_shipped_default_lets_only_this_machines_user_command() -> None:
    settings = load_stream("loopback")
    assert settings.is_local
    assert settings.operators == (Operator("local", COMMANDS, None),)


@pytest.mark.parametrize(
    "where",
    ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.20:7447", "tcp/rig.example:7447",
     "tcp/127.example:1", "tcp/127.0.0.1.example:1"],
)  # fmt: skip
@pytest.mark.parametrize("key", ["listen", "connect"])
def test_an_open_stream_off_loopback_is_refused(tmp_path: Path, where: str, key: str) -> None:
    reported = problems(tmp_path, f"{key}: [{where!r}]\n")
    assert "mine.yaml:2" in reported
    assert "open to whoever reaches it" in reported
    assert "use tls/" in reported


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "localhost", "[::1]"])
def test_loopback_may_be_open(tmp_path: Path, host: str) -> None:
    assert profile(tmp_path, f"listen: ['tcp/{host}:7447']\n").is_local


@pytest.mark.parametrize(("known", "where"), [(TLS, "tls/0.0.0.0:1"), (LOGIN, "tcp/0.0.0.0:1")])
def test_who_is_known_still_needs_access_control(tmp_path: Path, known: str, where: str) -> None:
    assert "add `access" in problems(tmp_path, f"listen: [{where}]\n{known}")
    assert not profile(tmp_path, f"listen: [{where}]\n{known}{ACCESS}").is_local


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("listen: [tls/127.0.0.1:1]\n", "no certificates"),
        (TLS, "used by no endpoint"),
        (ACCESS, "cannot tell who anybody is"),
        ("login: {user: a, password_file: p}\n", "knows nobody"),
        ("listen: [udp/127.0.0.1:1]\n", "no endpoint"),
        ("listen: [tcp/127.0.0.1]\n", "no host and port"),
        ("listen: [tcp/127.0.0.1:99999]\n", "no host and port"),
        ("listen: ['tcp/127.0.0.1:1#iface=eth0']\n", "has options"),
        ("commands: [{operator: a, allow: [launch]}]\n", "abort"),
        ("commands: {operator: a}\n", "is not a list"),
        ("commands: [{operator: a, allow: []}, {operator: a, allow: []}]\n", "twice"),
        ('commands: [{operator: " ", allow: []}]\n', "must have 1 to 64 characters"),
        (f"commands: [{{operator: {65 * 'a'}, allow: []}}]\n", "must have 1 to 64 characters"),
        ("batch: 0\n", "greater than or equal"),
        ("history: 1 h\n", "is above"),
        ("lissen: []\n", "did you mean listen"),
        ("tls: {authority: a}\n", "certificate"),
        ("tls: 7\nlisten: [tls/127.0.0.1:1]\n", "not a mapping"),
    ],
)
def test_a_mistake_is_reported_with_its_line(tmp_path: Path, text: str, reported: str) -> None:
    message = problems(tmp_path, text)
    assert reported in message
    assert "mine.yaml:" in message


def test_paths_count_from_the_profiles_folder(tmp_path: Path) -> None:
    settings = profile(
        tmp_path,
        "listen: [tls/0.0.0.0:1]\ncommands: [{operator: a, allow: [abort], key: keys/a.key}]\n"
        + TLS + ACCESS,
    )  # fmt: skip
    assert settings.tls is not None
    assert settings.tls.authority == tmp_path / "a.pem"
    assert settings.operators[0].key_file == tmp_path / "keys" / "a.key"


def test_checking_a_profile_shows_what_it_amounts_to() -> None:
    reported = str(check("mtls"))
    assert "tls/0.0.0.0:7447" in reported
    assert "console may abort, hold, resume, skip, retry, note, acknowledge" in reported


def test_an_unknown_profile_is_reported_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="available stream: fleet, loopback, mtls"):
        load_stream("opened", tmp_path)
