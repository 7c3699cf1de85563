"""What a stream's profile says: where it listens, who may read, who may command, what is sent."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

Mode = Literal["peer", "client", "router"]
CommandName = Literal["abort", "hold", "resume", "skip", "retry", "note", "acknowledge"]
COMMANDS: Final[tuple[CommandName, ...]] = (
    "abort", "hold", "resume", "skip", "retry", "note", "acknowledge",
)  # fmt: skip

DEFAULT_PORT: Final = 7447
LOOPBACK_NAMES: Final = ("localhost", "::1")
PROTOCOLS: Final = ("tcp", "tls")


@dataclass(frozen=True)
class Endpoint:
    """Where Zenoh listens or connects: `tcp/127.0.0.1:7447`, `tls/rig.example:7447`.

    Attributes:
        protocol: `tcp` or `tls`.
        host: name or address, without brackets.
        port: 0 for any free one.
    """

    protocol: str
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> "Endpoint":
        """Return the endpoint that a text names.

        Raises:
            ValueError: it names none; says what is wrong.
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
        """Whether only this machine is reached by it."""
        parts = self.host.split(".")
        is_address = len(parts) == 4 and all(part.isdecimal() for part in parts)
        return self.host in LOOPBACK_NAMES or (is_address and parts[0] == "127")

    def __str__(self) -> str:
        """Return the text that Zenoh reads."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"


@dataclass(frozen=True)
class Tls:
    """Certificates of both ends; each end verifies the other's (mutual TLS).

    Attributes:
        authority: of the authority that signed all of them, PEM.
        certificate: of this end, PEM.
        private_key: of that certificate, PEM.
    """

    authority: Path
    certificate: Path
    private_key: Path


@dataclass(frozen=True)
class Login:
    """User and password by which ends know each other.

    Attributes:
        user: of this end.
        password_file: holds its password.
        users: of the end that listens: lines `user:password` of all that may connect.
    """

    user: str
    password_file: Path
    users: Path | None = None


@dataclass(frozen=True)
class Access:
    """Who may do what: common names of certificates, or users; everybody else may do nothing.

    Attributes:
        readers: may read the stream.
        commanders: may read it, and send commands; which ones, `Operator` says.
        rigs: may publish a stream; of a router that rigs connect to.
    """

    readers: tuple[str, ...] = ()
    commanders: tuple[str, ...] = ()
    rigs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Operator:
    """Somebody who may command, known by a secret key.

    Attributes:
        name: who it is, in logs and recordings.
        allow: which commands; no others.
        key_file: holds the key, 64 hexadecimal digits; None: this user's own on this machine.
    """

    name: str
    allow: tuple[CommandName, ...]
    key_file: Path | None = None


@dataclass(frozen=True)
class StreamSettings:
    """A stream; the default listens on this machine only, and takes no command at all.

    Attributes:
        mode: of the Zenoh session: `peer` for a direct connection, `client` by way of a router.
        listen: where it listens.
        connect: what it connects to, such as a router.
        tls: certificates, None without TLS.
        login: user and password, None without.
        access: who may do what; None: whoever connects may read.
        operators: who may command, and what; nobody, if not given.
        batch: samples in a message.
        history_s: how much of the past a late joiner can ask for.
        heartbeat_s: time between two heartbeats.
        channels: which channels are sent; all, if none is named.
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
        """Whether this machine alone is reached."""
        return all(endpoint.is_loopback for endpoint in (*self.listen, *self.connect))
