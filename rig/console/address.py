"""The address and names at which the console may be served; beyond this machine TLS is needed."""

import ipaddress
import ssl
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

LOOPBACK_NAMES: Final = ("localhost", "127.0.0.1", "[::1]")


class AddressError(ValueError):
    """The error of an address at which the console cannot be served, with reason and remedy."""


@dataclass(frozen=True)
class Address:
    """The address at which the console listens.

    Attributes:
        host: host name or IP address, without brackets.
        port: the port; 0 for any free one.
        names: allowed values of a browser's header Host, lower case: host names with port, for the
            ports 80 and 443 also without.
        certificate: PEM file of the server's certificate; None without TLS.
        key: PEM file of the certificate's private key; None without TLS.
    """

    host: str
    port: int
    names: frozenset[str]
    certificate: Path | None = None
    key: Path | None = None

    @property
    def secure(self) -> bool:
        """Whether the page is served over TLS."""
        return self.certificate is not None

    @property
    def url(self) -> str:
        """The URL to open in a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.secure else 'http'}://{host}:{self.port}/"


def address_of(
    listen: str, names: Sequence[str], certificate: Path | None, key: Path | None
) -> Address:
    """Return the address at which a console is to listen.

    Args:
        listen: text of the form HOST:PORT.
        names: further host names, without port, by which browsers may reach the console.
        certificate: PEM file of the server's certificate; None without TLS.
        key: PEM file of its private key; None without TLS.

    Raises:
        AddressError: the text is no address, only one of certificate and key is given, other
            machines could reach it without TLS, the certificate is unusable, or the host is every
            address of this machine and `names` is empty.
    """
    host, colon, port_text = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not port_text.isdecimal() or int(port_text) > 65535:
        raise AddressError("is no address; write it like 127.0.0.1:8480")
    port, ip = int(port_text), _ip_address(host)
    is_loopback = host == "localhost" or (ip is not None and ip.is_loopback)
    is_any = ip is not None and ip.is_unspecified
    if (certificate is None) != (key is None):
        raise AddressError("--certificate and --key go together; give both")
    if certificate is None and not is_loopback:
        raise AddressError(
            "is reached from other machines, so that the token could be read on the way; give "
            "--certificate and --key, or listen on 127.0.0.1 and forward the port: "
            f"ssh -L {port}:127.0.0.1:{port} THIS-MACHINE"
        )
    if certificate is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
        except (OSError, ssl.SSLError) as error:
            reason = getattr(error, "strerror", None) or error
            raise AddressError(f"{certificate} and {key} cannot be used: {reason}") from None
    if is_any and not names:
        raise AddressError("is every address of this machine; say by --name how browsers call it")
    known = [] if is_any else [f"[{host}]" if ":" in host else host]
    if is_loopback or is_any:
        known += LOOPBACK_NAMES
    return Address(host, port, _with_port([*known, *names], port), certificate, key)


def with_port(address: Address, port: int) -> Address:
    """Return a copy of an address with this port, in `port` and in all `names`.

    It is for an address whose port was 0, once the free port that it got is known.
    """
    bare = [name.rpartition(":")[0] for name in address.names if name.endswith(f":{address.port}")]
    return replace(address, port=port, names=_with_port(bare, port))


def _with_port(names: Sequence[str], port: int) -> frozenset[str]:
    # A browser leaves out the default port of HTTP or HTTPS in the header Host.
    bare = names if port in (80, 443) else ()
    return frozenset(name.lower() for name in (*(f"{name}:{port}" for name in names), *bare))


def _ip_address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return the IP address that a text is; None for a host name."""
    with suppress(ValueError):
        return ipaddress.ip_address(host)
    return None
