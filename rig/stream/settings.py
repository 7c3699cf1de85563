"""The settings of a stream: where it listens, who may read, who may command, what is sent."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

Mode = Literal["peer", "client", "router"]
CommandName = Literal[
    "abort", "hold", "resume", "skip", "retry", "note", "acknowledge", "jog", "beat"
]
COMMANDS: Final[tuple[CommandName, ...]] = get_args(CommandName)
JOGGING: Final[tuple[CommandName, ...]] = ("jog", "beat")
"""Commands of manual mode: a line of `rig jog`, and the heartbeat of who moves the ram."""

DEFAULT_PORT: Final = 7447
LOOPBACK_NAMES: Final = ("localhost", "::1")
PROTOCOLS: Final = ("tcp", "tls")


@dataclass(frozen=True)
class Endpoint:
    """An address at which Zenoh listens or connects, such as `tls/rig.example:7447`.

    Attributes:
        protocol: `tcp` or `tls`.
        host: host name or IP address, without brackets.
        port: the port; 0 for any free one.
    """

    protocol: str
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> "Endpoint":
        """Return the endpoint that a text of the form PROTOCOL/HOST:PORT names.

        Raises:
            ValueError: the text is no endpoint. The message is a phrase on what is wrong, such as
                "has no host and port", to be put after the text.
        """
        protocol, slash, address = text.partition("/")
        host, colon, port = address.rpartition(":")
        if not slash or protocol not in PROTOCOLS:
            raise ValueError(f"is no endpoint over {' or '.join(PROTOCOLS)}")
        if any(sign in address for sign in "?#; "):
            raise ValueError("has options, which a profile gives by its own keys")
        if not colon or not host or not port.isdecimal() or int(port) > 65535:
            raise ValueError("has no host and port")
        return cls(protocol, host.removeprefix("[").removesuffix("]"), int(port))

    @property
    def is_loopback(self) -> bool:
        """Whether the host is localhost, ::1 or 127.x.x.x, so that only this machine reaches it.

        Other host names are not looked up.
        """
        parts = self.host.split(".")
        is_address = len(parts) == 4 and all(part.isdecimal() for part in parts)
        return self.host in LOOPBACK_NAMES or (is_address and parts[0] == "127")

    def __str__(self) -> str:
        """Return the endpoint in the form that Zenoh reads, such as `tcp/127.0.0.1:7447`."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"


@dataclass(frozen=True)
class Tls:
    """The certificates for mutual TLS, by which each end verifies the other.

    Attributes:
        authority: PEM file with the certificate of the authority that signed all others.
        certificate: PEM file with the certificate of this end.
        private_key: PEM file with the private key of this end's certificate.
    """

    authority: Path
    certificate: Path
    private_key: Path


@dataclass(frozen=True)
class Login:
    """The user and password by which an end that connects proves who it is.

    Attributes:
        user: user name of this end.
        password_file: file that holds this end's password.
        users: file with lines `user:password` of all who may connect, for an end that listens;
            None for one that only connects.
    """

    user: str
    password_file: Path
    users: Path | None = None


@dataclass(frozen=True)
class Access:
    """The access control of a stream; names that are not listed may do nothing.

    The names are common names of certificates with TLS, else users.

    Attributes:
        readers: names that may read the stream.
        commanders: names that may read the stream and send commands; `Operator` says which ones.
        rigs: names that may publish a stream, for a router to which rigs connect.
    """

    readers: tuple[str, ...] = ()
    commanders: tuple[str, ...] = ()
    rigs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Operator:
    """Somebody who may send commands, which are signed with a secret key.

    Attributes:
        name: name in logs and recordings.
        allow: the commands that are allowed.
        key_file: file with the key, 64 hexadecimal digits; None for this user's own key on this
            machine.
    """

    name: str
    allow: tuple[CommandName, ...]
    key_file: Path | None = None


@dataclass(frozen=True)
class StreamSettings:
    """The settings of a stream; the default listens on this machine only and accepts no command.

    Attributes:
        mode: mode of the Zenoh session: `peer` for direct connections, `client` for a connection
            to a router, or `router`.
        listen: endpoints at which it listens.
        connect: endpoints to which it connects, such as a router's.
        tls: certificates; None without TLS.
        login: user and password; None without.
        access: who may do what; if None, everybody who can connect may read.
        operators: who may send which commands; if empty, nobody may.
        batch: samples in a message.
        history_s: length in s of the past that a late joiner can ask for.
        heartbeat_s: time in s between two heartbeats.
        channels: names of the channels that are sent; if empty, all are sent.
    """

    mode: Mode = "peer"
    listen: tuple[Endpoint, ...] = (Endpoint("tcp", "127.0.0.1", DEFAULT_PORT),)
    connect: tuple[Endpoint, ...] = ()
    tls: Tls | None = None
    login: Login | None = None
    access: Access | None = None
    operators: tuple[Operator, ...] = ()
    batch: int = 20
    history_s: float = 30.0
    heartbeat_s: float = 0.5
    channels: tuple[str, ...] = ()

    @property
    def is_local(self) -> bool:
        """Whether all endpoints are on loopback, so that the stream stays on this machine."""
        return all(endpoint.is_loopback for endpoint in (*self.listen, *self.connect))
