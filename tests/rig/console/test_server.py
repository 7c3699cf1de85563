"""What a browser may do at the console, and all that it may not, by plain requests."""

import json
import re
import shutil
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from rig.console.guard import LARGEST_BODY
from rig.console.launcher import Launcher, Served
from rig.console.orders import LONGEST_TEXT, Orders
from rig.console.server import LARGEST_MESSAGE
from rig.console.visitors import FAILURES
from rig.stream.answers import Answer
from rig.stream.known import Snapshot
from tests.waiting import PATIENCE_S

from .fakes import start_by, until
from .site import TOKEN, Site, site_served


def test_nobody_sees_the_page_before_logging_in(site: Site) -> None:
    reply = site.ask("GET", "/")
    assert (reply.status, reply.headers["location"]) == (303, "/login")
    login = site.ask("GET", "/login")
    assert (login.status, "Token" in login.text) == (200, True)
    assert TOKEN not in login.text


def test_the_cookie_of_a_login_is_the_browsers_alone(site: Site) -> None:
    reply = site.log_in()
    assert (reply.status, reply.headers["location"]) == (303, "/")
    assert re.match(
        rf"rig-console-{site.port}=\S+; HttpOnly; Max-Age=43200; Path=/; SameSite=strict$",
        reply.headers["set-cookie"],
    )
    page = site.ask("GET", "/", headers=site.cookie())
    assert (page.status, "Rig console" in page.text) == (200, True)


def test_over_tls_the_cookie_goes_over_tls_only(tmp_path: Path, leaving: ExitStack) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes the certificate, is not installed")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
         "-nodes", "-keyout", "this.key", "-out", "this.pem", "-subj", "/CN=rig",
         "-addext", "subjectAltName=IP:127.0.0.1"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    with site_served(leaving, tmp_path / "this.pem", tmp_path / "this.key") as site:
        reply = site.log_in()
        assert (reply.status, reply.headers["set-cookie"].endswith("; Secure")) == (303, True)
        assert "max-age" in reply.headers["strict-transport-security"]
        assert site.ask("GET", "/", headers=site.cookie()).status == 200
        plain = {"Origin": site.origin.replace("https", "http")}
        assert site.ask("POST", "/login", urlencode({"token": TOKEN}), plain).status == 403


def test_a_wrong_token_is_refused_and_logged_and_guessing_takes_long(site: Site) -> None:
    for _ in range(FAILURES):
        reply = site.log_in(token="<guess>")
        assert (reply.status, "set-cookie" in reply.headers) == (403, False)
        assert "not the token" in reply.text
    assert site.is_logged("refused, from 127.0.0.1: login: this is not the token")
    reply = site.log_in(token="<guess>")
    assert (reply.status, int(reply.headers["retry-after"]) > 50) == (429, True)
    assert site.log_in().status == 303


@pytest.mark.parametrize("path", ["/order", "/logout", "/order?order=stop&rig=bench"])
def test_nothing_is_done_by_get(site: Site, path: str) -> None:
    who = site.cookie()
    assert site.ask("GET", path, headers=who).status == 405
    assert site.ask("GET", f"/login?token={TOKEN}&name=Anna").headers.get("set-cookie") is None
    assert site.ask("GET", "/", headers=who).status == 200
    assert site.client.sent == []


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH"])
def test_other_methods_are_refused(site: Site, method: str) -> None:
    assert site.ask(method, "/order").status == 405


@pytest.mark.parametrize(
    "origin", ["", "null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1"]
)
def test_requests_of_other_sites_are_refused_and_logged(site: Site, origin: str) -> None:
    who = site.cookie()
    headers = {"Content-Type": "application/json", **who, "Origin": origin.format(port=site.port)}
    body = json.dumps({"order": "stop", "rig": "bench"})
    assert site.ask("POST", "/order", body, headers).status == 403
    assert site.log_in(Origin=origin).status == 403
    assert site.ask("POST", "/logout", headers=headers).status == 403
    with pytest.raises(InvalidStatus) as refused:
        site.live(who, Origin=origin.format(port=site.port))
    assert refused.value.response.status_code == 403
    assert site.client.sent == []
    assert site.is_logged("a request from another site")


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", ""])
def test_another_name_is_refused_so_that_none_can_be_rebound(site: Site, host: str) -> None:
    told = host.format(port=site.port) or " "
    headers = {"Host": told, "Origin": f"http://{told}"}
    assert site.ask("GET", "/login", headers=headers).status == 421
    assert site.ask("POST", "/login", urlencode({"token": TOKEN}), headers).status == 421


def test_nobody_orders_without_having_logged_in(site: Site) -> None:
    stranger = {"Cookie": f"rig-console-{site.port}=guess"}
    status, answer = site.order(stranger, order="stop", rig="bench")
    assert (status, answer["accepted"]) == (401, False)
    assert site.client.sent == []
    assert site.is_logged("an order from nobody")


def test_an_order_sent_again_after_its_sender_has_gone_is_refused_and_logged(site: Site) -> None:
    who = site.cookie()
    assert site.order(who, order="stop", rig="bench")[0] == 200
    site.ask("POST", "/logout", headers=who)
    assert site.order(who, order="stop", rig="bench")[0] == 401
    assert len(site.client.sent) == 1
    assert site.is_logged("an order from nobody")


@pytest.mark.parametrize("order", ["start", "go on"])
@pytest.mark.parametrize("name", ["../bench", "/etc/passwd", "--help", "a/../../b", "%2e%2e", "."])
def test_nothing_is_started_by_a_path_and_that_is_logged(
    site: Site, tmp_path: Path, order: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Any] = []
    start_by(monkeypatch, started.append)
    launcher = Launcher(Served((), tmp_path / "runs", "loopback"), print)
    site.client.become("bench", alive=False)
    site.console.orders = Orders(site.client, site.console.control, launcher)
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "journal.jsonl").write_text('{"kind": "begin", "campaign": "a"}\n')
    who = site.cookie()
    site.order(who, order="take")
    status, answer = site.order(who, order=order, name=name)
    assert (status, answer["accepted"]) == (409, False)
    assert site.is_logged(f"Anna: {order} {re.escape(name)} refused, ")
    assert started == []


@pytest.mark.parametrize(
    "body",
    [
        "", "stop", "[]", "null", "1", "{}", '{"order": 1}', '{"order": "stop", "more": ""}',
        '{"order": "explode"}', '{"order": "stop", "rig": null}', "[" * 2000, b"\xff\xfe",
        '{"order": "note", "order": "stop"}',
        '{"order": "skip", "name": "%s"}' % ("x" * 201),
        '{"order": "note", "text": "%s"}' % ("x" * (LONGEST_TEXT + 1)),
    ],
)  # fmt: skip
def test_malformed_orders_are_refused_and_logged(site: Site, body: str | bytes) -> None:
    headers = {"Content-Type": "application/json", **site.cookie()}
    reply = site.ask("POST", "/order", body, headers)
    assert (reply.status, json.loads(reply.text)["accepted"]) == (400, False)
    assert site.client.sent == []
    assert site.is_logged("an order that ")


def test_an_order_that_is_not_declared_as_json_is_refused(site: Site) -> None:
    headers = {"Content-Type": "text/plain", **site.cookie()}
    body = json.dumps({"order": "stop", "rig": "bench"})
    assert site.ask("POST", "/order", body, headers).status == 400
    assert site.client.sent == []


def test_oversized_requests_are_refused_and_logged(site: Site) -> None:
    who = {"Content-Type": "application/json", **site.cookie()}
    assert site.ask("POST", "/order", "x" * (LARGEST_BODY + 1), who).status == 413
    piece = b"%x\r\n%s\r\n" % (LARGEST_BODY, b"x" * LARGEST_BODY)
    chunked = {**who, "Transfer-Encoding": "chunked"}
    assert site.ask("POST", "/order", piece * 2 + b"0\r\n\r\n", chunked).status == 413
    assert site.is_logged("a body of more than 4096 bytes")


@pytest.mark.parametrize(
    "name", ["console.html", "..%2Fserver.py", "../server.py", "%2e%2e/server.py", "", "none.js"]
)
def test_no_other_file_is_served(site: Site, name: str) -> None:
    assert site.ask("GET", f"/page/{name}").status in (404, 307)


@pytest.mark.parametrize("name", ["console.js", "console.css", "icon.svg"])
def test_the_page_may_load_what_is_its_own_only(site: Site, name: str) -> None:
    reply = site.ask("GET", f"/page/{name}")
    assert (reply.status, len(reply.text) > 100) == (200, True)
    policy = reply.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert reply.headers["x-frame-options"] == "DENY"
    assert reply.headers["cache-control"] == "no-store"


def test_who_has_control_may_act_and_is_named_in_the_record(site: Site) -> None:
    anna = site.cookie("Anna")
    assert site.order(anna, order="hold", rig="bench") == (
        409, {"accepted": False, "reason": "nobody has control; take it first"},
    )  # fmt: skip
    assert site.order(anna, order="take")[0] == 200
    assert site.order(anna, order="hold", rig="bench", text="lunch")[0] == 200
    assert site.order(anna, order="skip", rig="bench", name="first")[0] == 200
    assert site.client.sent == [
        ("hold", "bench", "Anna: lunch", ""),
        ("skip", "bench", "Anna", "first"),
    ]
    assert site.is_logged("Anna: skip first")


def test_a_second_operator_is_refused_but_may_stop(site: Site) -> None:
    anna, ben = site.cookie("Anna"), site.cookie("Ben")
    site.order(anna, order="take")
    for refused in ("take", "hold", "resume", "abort", "acknowledge", "start", "release"):
        status, answer = site.order(ben, order=refused, rig="bench", name="leaks")
        assert (status, "Anna has control" in answer["reason"]) == (409, True)
    assert site.client.sent == []
    assert site.order(ben, order="stop", rig="bench")[0] == 200
    assert site.client.sent == [("abort", "bench", "Ben", "")]
    assert site.order(ben, order="take over")[0] == 200
    assert site.order(anna, order="hold", rig="bench")[1]["reason"] == "Ben has control"


def test_a_refusal_of_the_rig_is_handed_on(site: Site) -> None:
    site.client.answer = Answer(False, "the campaign is not paused")
    anna = site.cookie()
    site.order(anna, order="take")
    _, answer = site.order(anna, order="resume", rig="bench")
    assert answer["reason"] == "the campaign is not paused"
    assert "was not heard of" in site.order(anna, order="hold", rig="other")[1]["reason"]
    status, answer = site.order(anna, order="stop", rig="")
    assert (status, answer["accepted"]) == (409, False)


def test_who_logs_out_gives_up_control_and_is_nobody(site: Site) -> None:
    anna = site.cookie()
    site.order(anna, order="take")
    assert site.ask("POST", "/logout", headers=anna).headers["location"] == "/login"
    assert site.console.control.holder is None
    assert site.order(anna, order="take")[0] == 401


# ---- the live view ------------------------------------------------------------------------------


def heard(live: ClientConnection, name: str) -> dict[str, Any]:
    """Return the next message that has something of this name."""
    while True:
        message: dict[str, Any] = json.loads(live.recv(timeout=30))
        for part in (message, message.get("common", {}), message.get("sections", {})):
            if name in part:
                return message


def closed_with(live: ClientConnection) -> int | None:
    """Return the code with which the console ends a view."""
    try:
        while True:
            live.recv(timeout=30)
    except ConnectionClosed as closed:
        return closed.rcvd.code if closed.rcvd is not None else None


def test_a_viewer_is_sent_everything_and_then_what_changes(site: Site) -> None:
    with site.live(site.cookie()) as live:
        about = json.loads(live.recv())
        assert about.items() >= {"you": 1, "name": "Anna"}.items()
        assert 0 <= time.time() - 1e-3 * about["now_ms"] < PATIENCE_S
        told = heard(live, "life")
        assert told["rig"] == "bench"
        assert told["sections"]["life"]["life"] == "live"
        assert told["sections"]["campaign"]["name"] == "leaks"
        assert heard(live, "points")["points"]["position_mm"]
        site.client.become("bench", alive=False, age_s=7.0)
        later = heard(live, "life")["sections"]
        assert (later["life"]["life"], later["life"]["age_s"]) == ("dead", 7.0)
        assert "campaign" not in later


def test_a_viewer_hears_that_the_console_is_there_where_there_is_no_news(site: Site) -> None:
    site.client.shots.clear()
    with site.live(site.cookie()) as live:
        assert [json.loads(live.recv(timeout=30)) for _ in range(6)].count({}) >= 2


def test_a_viewer_that_comes_back_is_sent_everything_again(site: Site) -> None:
    who = site.cookie()
    site.order(who, order="take")
    for _ in range(2):
        with site.live(who) as live:
            assert heard(live, "holder")["common"]["holder"]["name"] == "Anna"
            assert len(heard(live, "points")["points"]["time_s"]) >= 1


def test_all_viewers_are_shown_who_takes_over(site: Site) -> None:
    anna, ben = site.cookie("Anna"), site.cookie("Ben")
    with site.live(anna) as hers, site.live(ben) as his:
        site.order(anna, order="take")
        site.order(ben, order="take over")
        for live in (hers, his):
            while "Ben takes over from Anna" not in json.dumps(heard(live, "notices")):
                pass


def test_nobody_watches_without_having_logged_in(site: Site) -> None:
    with site.live({}) as live:
        assert closed_with(live) == 4401
    assert site.is_logged("a live view for nobody")


def test_who_is_logged_out_watches_no_more(site: Site) -> None:
    who = site.cookie()
    with site.live(who) as live:
        heard(live, "life")
        site.ask("POST", "/logout", headers=who)
        assert closed_with(live) == 4401


@pytest.mark.parametrize(
    ("message", "code", "told"),
    [
        ("x" * (LARGEST_MESSAGE + 1), 1009, "a message of more than 1024 bytes"),
        (b"x" * (LARGEST_MESSAGE + 1), 1009, "a message of more than 1024 bytes"),
        ("nonsense", 1008, "a malformed message"),
        ("[" * 900, 1008, "a malformed message"),
        (b"\x80\x81", 1008, "a malformed message"),
        ('{"rig": 7}', 1008, "a malformed message"),
        ('{"rig": "bench", "order": "stop"}', 1008, "a malformed message"),
        ('{"order": "stop"}', 1008, "a malformed message"),
        ('{"rig": "bench", "rig": "other"}', 1008, "a malformed message"),
    ],
)
def test_oversized_and_malformed_messages_end_the_view_and_are_logged(
    site: Site, message: str | bytes, code: int, told: str
) -> None:
    with site.live(site.cookie()) as live:
        live.send(message)
        assert closed_with(live) == code
    until(lambda: site.is_logged(told), told)
    assert site.client.sent == []


def test_a_text_that_is_none_is_a_malformed_message_in_a_line_of_the_log(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    with site.live(site.cookie()) as live:
        live.send(b"\xff", text=True)
        assert closed_with(live) == 1008
    until(lambda: site.is_logged("a malformed message"), "the refusal")
    assert caplog.records == []


def flood(live: ClientConnection) -> None:
    """Send until it is refused, however slowly this machine does."""
    while True:
        live.send('{"rig": "bench"}')


def test_a_flood_of_messages_ends_the_view(site: Site) -> None:
    with site.live(site.cookie()) as live:
        with pytest.raises(ConnectionClosed):
            flood(live)
        assert closed_with(live) == 1008
    until(lambda: site.is_logged("too many messages"), "the log")


def test_a_failure_is_logged_once_and_the_view_goes_on(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> dict[str, Any]:
        raise OSError("the disk is gone")

    monkeypatch.setattr(site.console.launcher, "content", fail)
    with site.live(site.cookie()) as live:
        for _ in range(30):
            assert heard(live, "points")["points"]
        assert site.order(site.cookie("Ben"), order="take") == (
            200, {"accepted": True, "reason": ""},
        )  # fmt: skip
    (told,) = [line for line in site.log if "failure" in line]
    assert told.startswith("the console goes on after a failure: OSError: the disk is gone")


def test_another_rig_is_shown_when_it_is_asked_for(site: Site) -> None:
    site.client.shots["other"] = Snapshot(rig="other", alive=True, age_s=0.0)
    with site.live(site.cookie()) as live:
        assert heard(live, "life")["rig"] == "bench"
        live.send('{"rig": "other"}')
        while heard(live, "life")["rig"] != "other":
            pass
