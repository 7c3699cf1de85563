"""The shipped profiles keep their word, with real sessions: who may read reads, nobody else."""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rig.configuration.reading.lookup import shipped_config_dir
from rig.configuration.rigs.stream import load_stream
from rig.stream.client import StreamClient
from rig.stream.commands import Gate, Refused, gate_of, make_key
from rig.stream.messages import command_key, pack
from rig.stream.sender import StreamSender
from rig.stream.sessions import StreamError, check_files, publisher_session, subscriber_session
from rig.stream.settings import Access, Endpoint, StreamSettings
from tests.waiting import PATIENCE_S

SILENCE_S = 1.5
"""How long nothing comes before we say that nothing does: a reader that may gets it in 0.1 s."""


def place(folder: Path, profile: str, port: int) -> Path:
    """Copy a shipped profile to a folder, as a user would, but for its address."""
    text = (shipped_config_dir() / "stream" / f"{profile}.yaml").read_text()
    for shipped in ("0.0.0.0:7447", "127.0.0.1:7447", "router.example:7447"):
        text = text.replace(shipped, f"127.0.0.1:{port}")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{profile}.yaml"
    path.write_text(text)
    key = folder / "keys" / "console.key"
    make_key(key)
    return path


def with_certificate(folder: Path, certificates: Path, name: str, profile: str, port: int) -> Path:
    path = place(folder, profile, port)
    mine = folder / "certificates"
    mine.mkdir(exist_ok=True)
    shutil.copy(certificates / "authority.pem", mine / "authority.pem")
    for suffix in ("pem", "key"):
        shutil.copy(certificates / f"{name}.{suffix}", mine / f"this.{suffix}")
    return path


def with_password(folder: Path, user: str, password: str, port: int) -> Path:
    path = place(folder, "password", port)
    secrets = folder / "secrets"
    secrets.mkdir(exist_ok=True)
    (secrets / "this.password").write_text(password + "\n")
    (secrets / "users").write_text("rig:r\nreader:a\nconsole:b\nstranger:c\n")
    path.write_text(path.read_text().replace("user: rig", f"user: {user}"))
    return path


class Published:
    """A rig that sends its state again and again, and answers commands by its gate."""

    def __init__(self, settings: StreamSettings, rig: str = "bench") -> None:
        self.session = publisher_session(settings)
        self.sender = StreamSender(self.session, rig, 10.0, print)
        self.gate: Gate = gate_of(settings, rig, self.sender.name)
        self.obeyed: list[str] = []
        self.commands = self.session.declare_queryable(command_key(rig, "*"), self.answer)

    def answer(self, query: zenoh.Query) -> None:
        name = str(query.key_expr).rpartition("/")[2]
        reason = ""
        try:
            assert query.payload is not None
            self.obeyed.append(self.gate.judge(name, bytes(query.payload)).name)
        except Refused as refused:
            reason = str(refused)
        with query:
            query.reply(str(query.key_expr), pack({"accepted": not reason, "reason": reason}))

    def beat(self) -> None:
        self.sender.send("heartbeat", {"heartbeat_s": 0.5, "sequences": {}})
        self.sender.send("state", {"state": "armed"})


@contextmanager
def published(settings: StreamSettings, rig: str = "bench") -> Iterator[Published]:
    there = Published(settings, rig)
    try:
        yield there
    finally:
        there.sender.close()
        there.session.close()


def comes(rig: Published, done: Callable[[], Any], wait_s: float = PATIENCE_S) -> bool:
    """Return whether something happens while the rig sends."""
    until = time.monotonic() + wait_s
    while time.monotonic() < until:
        rig.beat()
        if done():
            return True
        time.sleep(0.05)
    return False


def reads(rig: Published, client: StreamClient, wait_s: float = PATIENCE_S) -> bool:
    return comes(
        rig,
        lambda: "bench" in client.rigs() and client.snapshot("bench").state.get("state"),
        wait_s,
    )


def receives(rig: Published, session: zenoh.Session, keys: str, wait_s: float) -> bool:
    """Return whether a plain subscriber of keys gets anything in time."""
    with session.declare_subscriber(keys, zenoh.handlers.RingChannel(10)) as subscriber:
        return comes(rig, lambda: subscriber.try_recv() is not None, wait_s)


@pytest.fixture
def certified(tmp_path: Path, certificates: Path, port: int) -> Callable[[str], StreamSettings]:
    """Return the settings of the profile mtls with the certificate of somebody."""
    return lambda name: load_stream(
        with_certificate(tmp_path / name, certificates, name, "mtls", port)
    )


def share_key(folder: Path, to: str) -> None:
    """Give somebody the rig's copy of the console's key."""
    shutil.copy(folder / "rig" / "keys" / "console.key", folder / to / "keys" / "console.key")


def test_by_certificate_a_reader_reads_and_a_commander_commands(
    tmp_path: Path, certified: Callable[[str], StreamSettings]
) -> None:
    with published(certified("rig")) as rig:
        reader, console = certified("reader"), certified("console")
        share_key(tmp_path, "reader")
        share_key(tmp_path, "console")
        with StreamClient(reader) as client:
            assert reads(rig, client)
            assert comes(rig, lambda: client.snapshot().alive)
            # It even has the key: its certificate is none of a commander.
            assert not client.send("abort", timeout_s=SILENCE_S).accepted
        assert rig.obeyed == []
        with StreamClient(console) as client:
            assert reads(rig, client)
            assert client.send("abort").accepted
        assert rig.obeyed == ["abort"]


def test_by_certificate_nobody_else_reads(
    tmp_path: Path, certificates: Path, certified: Callable[[str], StreamSettings], port: int
) -> None:
    elsewhere = load_stream(
        with_certificate(tmp_path / "elsewhere", certificates / "elsewhere", "reader", "mtls", port)
    )
    with published(certified("rig")) as rig:
        for settings in (certified("stranger"), elsewhere):
            with StreamClient(settings) as client:
                assert not reads(rig, client, SILENCE_S)
        # Without any certificate there is no connection at all.
        (there,) = certified("rig").listen
        without = StreamSettings(listen=(), connect=(replace(there, protocol="tcp"),))
        with StreamClient(without) as client:
            assert not reads(rig, client, SILENCE_S)


def test_a_reader_that_asks_for_more_than_the_stream_gets_nothing(
    certified: Callable[[str], StreamSettings],
) -> None:
    with published(certified("rig")) as rig:
        for keys in ("**", "rig/**"):
            with subscriber_session(certified("reader")) as session:
                assert not receives(rig, session, keys, SILENCE_S), keys
        with subscriber_session(certified("reader")) as session:
            assert receives(rig, session, "rig/bench/v1/*", PATIENCE_S)


def test_by_password_a_reader_reads_and_a_commander_commands(tmp_path: Path, port: int) -> None:
    with published(load_stream(with_password(tmp_path / "rig", "rig", "r", port))) as rig:
        reader = load_stream(with_password(tmp_path / "reader", "reader", "a", port))
        console = load_stream(with_password(tmp_path / "console", "console", "b", port))
        share_key(tmp_path, "reader")
        share_key(tmp_path, "console")
        with StreamClient(reader) as client:
            assert reads(rig, client)
            assert not client.send("abort", timeout_s=SILENCE_S).accepted
        with StreamClient(console) as client:
            assert reads(rig, client)
            assert client.send("abort").accepted
        assert rig.obeyed == ["abort"]


@pytest.mark.parametrize(("user", "password"), [("reader", "wrong"), ("stranger", "c")])
def test_by_password_nobody_else_reads(tmp_path: Path, port: int, user: str, password: str) -> None:
    with published(load_stream(with_password(tmp_path / "rig", "rig", "r", port))) as rig:
        settings = load_stream(with_password(tmp_path / user, user, password, port))
        with StreamClient(settings) as client:
            assert not reads(rig, client, SILENCE_S)


def test_through_the_shipped_router_rigs_are_followed_and_commanded(
    tmp_path: Path, certificates: Path, port: int
) -> None:
    def settings(name: str, profile: str) -> StreamSettings:
        folder = tmp_path / name
        return load_stream(with_certificate(folder, certificates, name, profile, port))

    routes = settings("stranger", "router")
    assert routes.access == Access(("reader",), ("console",), ("rig",))
    with publisher_session(routes), published(settings("rig", "fleet")) as rig:
        reader, console = settings("reader", "fleet"), settings("console", "fleet")
        share_key(tmp_path, "reader")
        share_key(tmp_path, "console")
        with StreamClient(reader) as client:
            assert reads(rig, client)
            assert not client.send("abort", timeout_s=SILENCE_S).accepted
            # Who may read may not pretend to be a rig.
            with (
                subscriber_session(console) as other,
                subscriber_session(reader) as liar,
                other.declare_subscriber("rig/bench/v1/*", zenoh.handlers.RingChannel(99)) as seen,
            ):
                until = time.monotonic() + SILENCE_S
                while time.monotonic() < until:
                    liar.put("rig/bench/v1/event", b"lie")
                    time.sleep(0.05)
                assert all(bytes(sample.payload) != b"lie" for sample in iter(seen.try_recv, None))
        with StreamClient(console) as client:
            assert reads(rig, client)
            assert client.send("abort").accepted
        assert rig.obeyed == ["abort"]


def test_on_loopback_rigs_share_the_port_and_outlive_each_other(tmp_path: Path, port: int) -> None:
    settings = load_stream(place(tmp_path, "loopback", port))
    with ExitStack() as stack:
        first_ends = stack.enter_context(ExitStack())
        first_ends.enter_context(published(settings, "first"))
        second = stack.enter_context(published(settings, "second"))
        with StreamClient(settings) as client:
            both = ("first", "second")
            assert comes(second, lambda: client.rigs() == both)
        first_ends.close()
        with StreamClient(settings) as late:
            assert comes(second, lambda: "second" in late.rigs() and late.snapshot("second").alive)


def test_a_missing_file_is_reported_before_anything_is_opened(tmp_path: Path, port: int) -> None:
    with pytest.raises(StreamError, match=r"authority\.pem: cannot be read"):
        check_files(load_stream(place(tmp_path, "mtls", port)))
    with pytest.raises(StreamError, match=r"this\.password"):
        check_files(load_stream(place(tmp_path, "password", port)))


def test_a_port_that_is_taken_is_reported(port: int) -> None:
    taken = StreamSettings(mode="router", listen=(Endpoint("tcp", "127.0.0.1", port),))
    with publisher_session(taken), pytest.raises(StreamError, match=f"127.0.0.1:{port}"):
        publisher_session(taken).close()
