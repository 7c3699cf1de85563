"""The console is reached from other machines over TLS only, under names that are known."""

from pathlib import Path

import pytest

from rig.console.address import AddressError, address_of, with_port


def test_on_this_machine_it_has_the_names_of_this_machine() -> None:
    address = address_of("127.0.0.1:8480", (), None, None)
    assert address.names == {"127.0.0.1:8480", "localhost:8480", "[::1]:8480"}
    assert address.url == "http://127.0.0.1:8480/"
    assert with_port(address_of("[::1]:0", (), None, None), 99).url == "http://[::1]:99/"


def test_a_free_port_is_in_the_names_as_it_is() -> None:
    address = with_port(address_of("127.0.0.1:0", ("rig",), None, None), 4711)
    assert {"127.0.0.1:4711", "rig:4711"} < address.names
    assert not any(name.endswith(":0") for name in address.names)


def test_the_port_of_the_scheme_may_be_left_out() -> None:
    assert {"localhost:80", "localhost"} < address_of("127.0.0.1:80", (), None, None).names


@pytest.mark.parametrize(
    "listen", ["0.0.0.0:8480", "192.168.1.20:8480", "rig.example:8480", "[::]:1"]
)
def test_open_to_others_without_tls_is_refused(listen: str) -> None:
    with pytest.raises(AddressError, match="--certificate and --key, or listen on"):
        address_of(listen, ("rig.example",), None, None)


@pytest.mark.parametrize("listen", ["", "8480", "host", "host:", ":8480", "host:99999", "host:x"])
def test_what_is_no_address_is_refused(listen: str) -> None:
    with pytest.raises(AddressError, match="is no address"):
        address_of(listen, (), None, None)


def test_half_a_certificate_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AddressError, match="go together"):
        address_of("127.0.0.1:1", (), tmp_path, None)


def test_a_certificate_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.pem").write_text("nothing")
    with pytest.raises(AddressError, match="cannot be used"):
        address_of("127.0.0.1:1", (), tmp_path / "c.pem", tmp_path / "c.pem")
    with pytest.raises(AddressError, match=r"cannot be used: No such file"):
        address_of("127.0.0.1:1", (), tmp_path / "none.pem", tmp_path / "none.pem")
