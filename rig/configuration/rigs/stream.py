"""Profiles of the live stream say where it listens, who may read it, and who may command."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from rig.configuration.reading import Located, Physical, Schema, elements_of, load, read_mapping
from rig.stream import (
    LONGEST_NAME,
    Access,
    CommandName,
    Endpoint,
    Login,
    Mode,
    Operator,
    StreamSettings,
    Tls,
)

OFF: Final = "off"
"""The text that users write in place of a profile if they want no stream."""
DEFAULT: Final = "loopback"


class StreamFile(Schema):
    """Keys of a stream's profile; the mappings under them have their own schemas."""

    name: str
    description: str = ""
    mode: Mode = "peer"
    listen: list[str] | None = None
    connect: list[str] = Field(default_factory=list)
    tls: Any = None
    login: Any = None
    access: Any = None
    commands: Any = None
    batch: Annotated[int, Field(ge=1, le=200)] = 20
    history: Annotated[float, Physical("s", 0.0, 120.0, 30.0)] = 30.0
    heartbeat: Annotated[float, Physical("s", 0.1, 10.0, 0.5)] = 0.5
    channels: list[str] = Field(default_factory=list)


class TlsFile(Schema):
    """Keys of `tls`, which name PEM files by paths that are relative to the profile's folder."""

    authority: str
    certificate: str
    private_key: str


class LoginFile(Schema):
    """Keys of `login`; its paths are relative to the profile's folder."""

    user: str
    password_file: str
    users: str | None = None


class AccessFile(Schema):
    """Keys of `access`: who may read the stream, who may command, and which rigs may publish.

    The names are common names of certificates with TLS, else users.
    """

    readers: list[str] = Field(default_factory=list)
    commanders: list[str] = Field(default_factory=list)
    rigs: list[str] = Field(default_factory=list)


class OperatorFile(Schema):
    """Keys of one entry of `commands`: an operator, the allowed commands, and a key's file."""

    operator: str
    allow: list[CommandName]
    key: str | None = None


def load_stream(reference: str | Path, base: Path | None = None) -> StreamSettings:
    """Return the settings of the stream that a profile describes, given by path or by name.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file.
    """
    return load("stream", reference, base, read_stream)


def read_stream(root: Located) -> StreamSettings | None:
    """Return the stream's settings in a file; record problems and return None if it has any."""
    problems = root.sources.problems
    before = problems.reported
    file = read_mapping(StreamFile, root)
    listen, connect = _endpoints(root.get("listen")), _endpoints(root.get("connect"))
    tls, login = _tls(root), _login(root)
    access = read_mapping(AccessFile, root.get("access"))
    operators = _operators(root.get("commands"))
    if file is None or problems.reported > before:
        return None
    settings = StreamSettings(
        mode=file.mode,
        listen=StreamSettings.listen if file.listen is None else listen,
        connect=connect,
        tls=tls,
        login=login,
        access=None if access is None else _access(access),
        operators=operators,
        batch=file.batch,
        history_s=file.history,
        heartbeat_s=file.heartbeat,
        channels=tuple(file.channels),
    )
    _check_open(root, settings)
    return settings if problems.reported == before else None


def _endpoints(item: Located | None) -> tuple[Endpoint, ...]:
    found = []
    for element in item.elements() if item is not None else ():
        try:
            found.append(Endpoint.parse(str(element.value)))
        except ValueError as error:
            element.refuse(str(error), "write like tcp/127.0.0.1:7447 or tls/rig.example:7447")
    return tuple(found)


def _tls(root: Located) -> Tls | None:
    file, folder = read_mapping(TlsFile, root.get("tls")), root.place.path.parent
    if file is None:
        return None
    return Tls(folder / file.authority, folder / file.certificate, folder / file.private_key)


def _login(root: Located) -> Login | None:
    file, folder = read_mapping(LoginFile, root.get("login")), root.place.path.parent
    if file is None:
        return None
    users = None if file.users is None else folder / file.users
    return Login(file.user, folder / file.password_file, users)


def _access(file: AccessFile) -> Access:
    return Access(tuple(file.readers), tuple(file.commanders), tuple(file.rigs))


def _operators(item: Located | None) -> tuple[Operator, ...]:
    found: dict[str, Operator] = {}
    for element in elements_of(item, "write a list: - {operator: NAME, allow: [abort]}"):
        file = read_mapping(OperatorFile, element)
        if file is None:
            continue
        name = file.operator
        if not 0 < len(name.strip()) <= LONGEST_NAME:
            limit = f"must have 1 to {LONGEST_NAME} characters"
            element.refuse(limit, "name the operator", name, "operator")
        if name in found:
            element.refuse("is there twice", "keep one", name, "operator")
        key = None if file.key is None else element.path_to(file.key)
        found[name] = Operator(name, tuple(file.allow), key)
    return tuple(found.values())


def _check_open(root: Located, settings: StreamSettings) -> None:
    """Record a problem where endpoints, TLS, login and access control of a profile do not fit.

    That is where more people could read or command the stream than the profile says, for example
    if it is served beyond this machine without TLS and without a login, and where TLS is given for
    no endpoint or the reverse.
    """
    # A problem with an empty key is placed as if the key were missing.
    root = root.with_value({key: item for key, item in root.items() if item.value is not None})
    encrypted = [end for end in (*settings.listen, *settings.connect) if end.protocol == "tls"]
    if encrypted and settings.tls is None:
        remedy = "add `tls: {authority: ..., ...}`"
        root.refuse("has no certificates", remedy, encrypted[0], "tls")
    if settings.tls is not None and not encrypted:
        root.refuse("is used by no endpoint", "write tls/HOST:PORT, or remove `tls`", "", "tls")
    if settings.access is not None and settings.tls is None and settings.login is None:
        root.refuse("cannot tell who anybody is", "add `tls` or `login`", "", "access")
    if settings.login is not None and settings.login.users is None and settings.listen:
        remedy = "add `users: FILE` of user:password lines"
        root.refuse("knows nobody that connects", remedy, "", "login")
    for end in (*settings.listen, *settings.connect):
        name = "listen" if end in settings.listen else "connect"
        if end.is_loopback:
            continue
        if end.protocol != "tls" and settings.login is None:
            limit = "is open to whoever reaches it, as it is not on loopback"
            remedy = "use tls/ with `tls`, or add `login`; or listen on 127.0.0.1"
            root.refuse(limit, remedy, end, name)
        elif name == "listen" and settings.access is None:
            limit = "lets whoever has a certificate or password do everything"
            remedy = "add `access: {readers: [...], commanders: [...]}`"
            root.refuse(limit, remedy, end, name)


def stream_lines(settings: StreamSettings) -> tuple[str, ...]:
    """Return the lines by which `rig check` describes a stream."""
    known = "certificates" if settings.tls else "user and password" if settings.login else "nobody"
    may = [f"{who.name} may {', '.join(who.allow) or 'nothing'}" for who in settings.operators]
    return (
        f"  {settings.mode}, listens on {_joined(settings.listen)}; "
        f"connects to {_joined(settings.connect)}",
        f"  told apart by {known}; "
        + ("whoever connects may read" if settings.access is None else "access controlled"),
        f"  commands: {'; '.join(may) or 'none'}",
    )


def _joined(endpoints: Iterable[Endpoint]) -> str:
    return ", ".join(map(str, endpoints)) or "nothing"
