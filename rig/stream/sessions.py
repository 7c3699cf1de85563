"""Zenoh sessions are opened here by a profile: addresses, certificates, users, access control."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import zenoh

from .messages import PREFIX, VERSION
from .settings import Access, Endpoint, StreamSettings

ANY_PORT: Final = Endpoint("tcp", "127.0.0.1", 0)
RETRY_MS: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
DROP_WAIT_US: Final = 1000
"""Time in us that a message waits for room in a reader's queue before it is dropped.

A slow reader can delay the others by this time.
"""
BLOCK_WAIT_US: Final = 1_000_000
"""Time in us after which a reader that takes no answers is disconnected; it may connect again.

Answers are given one after the other, so that it delays those to others by this time.
"""
ROUTED_WAIT_US: Final = BLOCK_WAIT_US // 2
"""The same of a router, which must give a reader up before a rig gives up the router."""
QUEUED_BATCHES: Final = 16
"""Batches of 64 KiB that may wait for a reader's connection, the most that Zenoh allows.

A router or reader that does not run for a tenth of a second then loses nothing of a hundred rigs.
"""
LARGEST_RECEIVED: Final = 64 * 1024
"""Most bytes of a message that a publisher receives, as it only gets commands and questions."""
REACH_MS: Final = 2000
"""Time in ms within which a router, or any other end that a session knows of, must be reached.

A session that is closed first waits for those that it is about to reach, stalled ones included.
"""
MOST_SESSIONS: Final = 512

_STREAM: Final = f"{PREFIX}/*/v{VERSION}/*"
_COMMANDS: Final = f"{PREFIX}/*/v{VERSION}/command/*"
_READING: Final = (
    "put", "reply", "declare_subscriber", "query", "declare_queryable", "liveliness_token",
    "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip


class StreamError(ValueError):
    """The error of a stream that cannot be opened, with address, reason and remedy."""


class UnreachableError(StreamError):
    """The error of a router that is not reached now; it may be reached later."""


def publisher_session(settings: StreamSettings) -> zenoh.Session:
    """Return an open session that publishes a rig's stream.

    With a peer profile on loopback, without TLS, login and access control, any number of rigs share
    the profile's port. The first rig listens on it; the others listen on free ports and connect to
    the first, which makes them known to readers. When the first has gone, another takes the port.
    In mode `client` the router must be reached now; other modes do not wait for those they connect
    to.

    Raises:
        UnreachableError: in mode `client`, no router is reached within `REACH_MS`.
        StreamError: the session cannot be opened: a port is taken (other profiles than those that
            share it), or a certificate or password file is missing or wrong.
    """
    listen, connect = list(settings.listen), list(settings.connect)
    if _is_shared(settings):
        connect += listen
        listen = [*listen, ANY_PORT]
    content = _common(replace(settings, listen=tuple(listen), connect=tuple(connect)))
    content["transport/link/rx/max_message_size"] = LARGEST_RECEIVED
    content["listen/exit_on_failure"] = not _is_shared(settings)
    content["listen/timeout_ms"] = -1 if _is_shared(settings) else 0
    content["listen/retry"] = RETRY_MS
    content["transport/unicast/max_sessions"] = MOST_SESSIONS
    wait_us = ROUTED_WAIT_US if settings.mode == "router" else BLOCK_WAIT_US
    content["transport/link/tx/queue/congestion_control/block/wait_before_close"] = wait_us
    return _opened(content)


def subscriber_session(settings: StreamSettings, connect: Sequence[Endpoint] = ()) -> zenoh.Session:
    """Return an open session that follows streams, and reconnects by itself.

    In mode `client` the router must be reached now; in other modes the session opens even if nobody
    is there yet.

    Args:
        settings: the rigs' profile, or one with the certificate or user of this end.
        connect: endpoints of the rigs; if empty, those that the profile connects to or else listens
            on.

    Raises:
        UnreachableError: in mode `client`, no router is reached within `REACH_MS`.
        StreamError: the session cannot be opened, as for a missing certificate or password file.
    """
    where = tuple(connect) or settings.connect or settings.listen
    shared = all(endpoint.is_loopback and endpoint.protocol == "tcp" for endpoint in where)
    alone = settings.tls is None and settings.login is None and shared
    mine = replace(
        settings,
        # A peer opens without a connection and waits for one; a client needs one to open.
        mode="client" if settings.mode == "client" else "peer",
        listen=(ANY_PORT,) if alone else (),
        connect=where,
        access=None,
        login=None if settings.login is None else replace(settings.login, users=None),
    )
    return _opened(_common(mine))


def check_files(settings: StreamSettings) -> None:
    """Raise unless all files of a profile's TLS and login can be read.

    The operators' key files are not checked.

    Raises:
        StreamError: a file does not exist or cannot be read.
    """
    parts = [part for part in (settings.tls, settings.login) if part is not None]
    given = [value for part in parts for value in vars(part).values()]
    for file in (value for value in given if isinstance(value, Path)):
        try:
            file.open("rb").close()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise StreamError(
                f"{file}: cannot be read: {reason}; docs/stream.md says how to make it"
            ) from None


def _is_shared(settings: StreamSettings) -> bool:
    plain = settings.tls is None and settings.login is None and settings.access is None
    return plain and settings.mode == "peer" and settings.is_local and bool(settings.listen)


def _common(settings: StreamSettings) -> dict[str, Any]:
    content: dict[str, Any] = {
        "mode": settings.mode,
        "listen/endpoints": [str(endpoint) for endpoint in settings.listen],
        "connect/endpoints": [str(endpoint) for endpoint in settings.connect],
        "connect/exit_on_failure": False,
        "connect/timeout_ms": REACH_MS if settings.mode == "client" else -1,
        "connect/retry": RETRY_MS,
        "transport/unicast/open_timeout": REACH_MS,
        "transport/unicast/accept_timeout": REACH_MS,
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "open/return_conditions/connect_scouted": False,
        "scouting/gossip/enabled": settings.is_local and settings.access is None,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": DROP_WAIT_US,
        "transport/link/tx/queue/size/data": QUEUED_BATCHES,
        "transport/link/tx/queue/size/data_low": QUEUED_BATCHES,
        "adminspace/enabled": False,
    }
    tls, login = settings.tls, settings.login
    if tls is not None:
        content["transport/link/tls"] = {
            "root_ca_certificate": str(tls.authority),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            **{f"{way}_certificate": str(tls.certificate) for way in ("listen", "connect")},
            **{f"{way}_private_key": str(tls.private_key) for way in ("listen", "connect")},
        }
    if login is not None:
        try:
            password = login.password_file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeError) as error:
            raise StreamError(f"{login.password_file}: password cannot be read: {error}") from None
        known = {} if login.users is None else {"dictionary_file": str(login.users)}
        content["transport/auth/usrpwd"] = {"user": login.user, "password": password, **known}
    if settings.access is not None:
        content["access_control"] = access_control(settings.access, by_name=tls is not None)
    return content


def access_control(access: Access, *, by_name: bool) -> dict[str, Any]:
    """Return Zenoh's configuration of access control: `access` is permitted, all else is denied.

    A subscription is only allowed if all its keys are the stream's; one to more keys gets nothing.

    Args:
        access: who may do what.
        by_name: whether the names in `access` are common names of certificates, rather than users.
    """
    both, into, out = ["ingress", "egress"], ["ingress"], ["egress"]
    rules = [
        # Seen from the rig, its messages go out to a reader, and the reader's requests come in.
        _rule("read", out, ("put", "reply", "liveliness_token", "declare_queryable"), _STREAM),
        _rule("ask", into, (*_READING[2:4], *_READING[6:]), _STREAM),
        _rule("command", into, ("query",), _COMMANDS),
        _rule("answer", out, ("reply", "declare_queryable"), _COMMANDS),
        _rule("publish", both, _READING, _STREAM),
        _rule("be-commanded", both, ("query", "reply", "declare_queryable"), _COMMANDS),
    ]
    read = ["read", "ask"]
    groups = (
        ("readers", access.readers, read),
        ("commanders", access.commanders, [*read, "command", "answer"]),
        ("rigs", access.rigs, ["publish", "be-commanded"]),
    )
    kind = "cert_common_names" if by_name else "usernames"
    used = [(name, who, may) for name, who, may in groups if who]
    needed = {rule for _, _, may in used for rule in may}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rule in rules if rule["id"] in needed],
        "subjects": [{"id": name, kind: list(who)} for name, who, _ in used],
        "policies": [{"rules": may, "subjects": [name]} for name, _, may in used],
    }


def _rule(name: str, flows: list[str], messages: Sequence[str], keys: str) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": flows,
        "messages": list(messages),
        "key_exprs": [keys],
    }


def _opened(content: Mapping[str, Any]) -> zenoh.Session:
    config = zenoh.Config()
    try:
        for name, value in content.items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = ", ".join([*content["listen/endpoints"], *content["connect/endpoints"]])
        reason = str(error).split(" at /")[0].strip()
        if content["mode"] == "client" and "Unable to connect" in reason:
            raise UnreachableError(f"{where}: no router is reached: {reason}") from None
        raise StreamError(
            f"{where}: stream cannot be opened: {reason}; is the port taken, are the files there?"
        ) from None
