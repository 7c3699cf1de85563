"""Fixtures with certificates and free ports for live streams on this machine."""

import shutil
import socket
import subprocess
from pathlib import Path

import pytest


@pytest.fixture
def port() -> int:
    """Return a free TCP port of this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


def make_authority(folder: Path) -> None:
    """Make a certificate authority in `folder`, as docs/stream.md describes it."""
    folder.mkdir(parents=True, exist_ok=True)
    openssl(folder, "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", "authority.key")
    openssl(
        folder, "req", "-x509", "-new", "-key", "authority.key", "-days", "3650",
        "-subj", "/CN=rigs", "-out", "authority.pem",
    )  # fmt: skip


def make_certificate(folder: Path, name: str, host: str = "IP:127.0.0.1") -> None:
    """Make a key, and a certificate signed by the authority in `folder`, as in docs/stream.md."""
    openssl(folder, "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", f"{name}.key")
    (folder / f"{name}.ext").write_text(f"subjectAltName={host}\n")
    openssl(folder, "req", "-new", "-key", f"{name}.key", "-subj", f"/CN={name}", "-out", "csr")
    openssl(
        folder, "x509", "-req", "-in", "csr", "-CA", "authority.pem", "-CAkey", "authority.key",
        "-CAcreateserial", "-days", "825", "-extfile", f"{name}.ext", "-out", f"{name}.pem",
    )  # fmt: skip


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with an authority, and its certificates of a rig and of several readers.

    The folder `elsewhere` in it has another authority with a reader's certificate.
    """
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes the certificates, is not installed")
    folder = tmp_path_factory.mktemp("certificates")
    make_authority(folder)
    for name in ("rig", "reader", "console", "stranger"):
        make_certificate(folder, name)
    make_authority(folder / "elsewhere")
    make_certificate(folder / "elsewhere", "reader")
    return folder
