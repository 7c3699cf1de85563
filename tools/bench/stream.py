"""Measures latency and loss of the live stream, for one rig and for hundreds behind one router.

`python -m tools.bench.stream` publishes rows at 1 kHz through a publisher process to readers in
processes of their own. Then it publishes the streams of 100 to 400 rigs through one router to one
reader. `--page FILE` also writes the tables into a page, between two marks.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from rig.loop.board import RING_ROWS, Board, Word
from rig.stream.client import StreamClient
from rig.stream.messages import Channels, Samples
from rig.stream.sender import StreamSender
from rig.stream.sessions import publisher_session
from rig.stream.settings import Endpoint, StreamSettings
from rig.supervisor.processes.streaming import Stream

from .shares import shares

COLUMNS: Final = 75
"""Number of columns of a row; a rig on hardware has about as many."""
NAMES: Final = ("time_s", *(f"channel_{k}_m" for k in range(COLUMNS - 2)), "segment")
FLEETS: Final = ((100, 20), (100, 100), (200, 100), (400, 100))
"""(number of rigs, samples in a message); in the profile `fleet`, a message has 100 samples."""
FLEET_CHANNELS: Final = 8
BATCH: Final = 20
PUBLISHERS: Final = 4
"""Number of processes that the rigs of a fleet share at most."""
BEGIN_MARK: Final = "<!-- table by tools.bench.stream: begin -->"
END_MARK: Final = "<!-- table by tools.bench.stream: end -->"


def follow(endpoint: str, mode: str, seconds: float) -> None:
    """Follow all rigs at an endpoint for a time, and print latency and loss as JSON.

    The object has the numbers of rigs (`rigs`, `alive`), of messages (`batches`) and of rows lost
    (`missing`), p50 and p99 of the latency (s) since sending (`sent_s`) and since the newest sample
    (`taken_s`), and the processors used (`cpu`).

    Args:
        endpoint: as text.
        mode: of the session, `peer` or `client`.
        seconds: for how long is measured, after 2 s that are not.
    """
    sent: list[float] = []
    taken: list[float] = []

    def on_message(rig: str, kind: str, content: Any) -> None:
        if kind == "samples":
            now = time.time_ns()
            sent.append(1e-9 * (now - content["sent_ns"]))
            taken.append(1e-9 * (now - content["newest_ns"]))

    where = (Endpoint.parse(endpoint),)
    settings = StreamSettings(mode=mode, listen=(), connect=where)  # type: ignore[arg-type]
    with StreamClient(settings, window_s=1.0, history=False, on_message=on_message) as client:
        time.sleep(2.0)
        sent.clear()
        taken.clear()
        begun = time.process_time()
        time.sleep(seconds)
        used = time.process_time() - begun
        rigs = client.rigs()
        missing = sum(client.snapshot(rig).missing.get("rows", 0) for rig in rigs)
        alive = sum(client.snapshot(rig).alive for rig in rigs)
    print(
        json.dumps(
            {
                "rigs": len(rigs), "alive": alive, "batches": len(sent), "missing": missing,
                "sent_s": np.percentile(sent, (50, 99)).tolist() if sent else [0, 0],
                "taken_s": np.percentile(taken, (50, 99)).tolist() if taken else [0, 0],
                "cpu": used / seconds,
            }
        )
    )  # fmt: skip


def follower(endpoint: str, mode: str, seconds: float) -> "subprocess.Popen[str]":
    """Start a process that runs `follow` with these arguments, and return it at once."""
    command = [sys.executable, "-m", "tools.bench.stream", "--follow", endpoint, mode]
    return subprocess.Popen(
        [*command, "--seconds", str(seconds)], stdout=subprocess.PIPE, text=True
    )


def one_rig(readers: int, seconds: float, port: int) -> list[dict[str, Any]]:
    """Publish rows of one rig at 1 kHz, and return what each reader printed (see `follow`).

    Args:
        readers: number of readers, each in a process of its own.
        seconds: for how long each reader measures.
        port: of the publisher on loopback.
    """
    endpoint = f"tcp/127.0.0.1:{port}"
    board = Board.create(COLUMNS)
    with tempfile.TemporaryDirectory() as folder:
        settings = StreamSettings(listen=(Endpoint.parse(endpoint),), batch=BATCH)
        stream = Stream(settings, "bench", Path(folder) / "log", print, lambda command: "no")
        stream.attach(board, NAMES)
        followers = [follower(endpoint, "peer", seconds) for _ in range(readers)]
        _write_rows(board, lambda: any(each.poll() is None for each in followers))
        found = [json.loads(each.communicate()[0]) for each in followers]
        stream.close()
    os.close(board.fd)
    return found


def _write_rows(board: Board, going_on: Any) -> None:
    """Write a row to the board each millisecond, until `going_on()` is False.

    The loop does the same, with better precision in time.
    """
    words, ring = board.words, board.ring
    due = time.monotonic()
    row = np.zeros(COLUMNS)
    row[-1] = 1.0
    while going_on():
        for _ in range(500):
            at = int(words[Word.ROWS])
            row[0] = 1e-3 * at
            ring[at % RING_ROWS] = row
            words[Word.LOOP_BEAT] = time.monotonic_ns()
            words[Word.ROWS] = at + 1
            due += 1e-3
            time.sleep(max(due - time.monotonic(), 0.0))


def publish_fleet(endpoint: str, count: int, batch: int) -> None:
    """Publish the streams of `count` rigs, each with a session of its own, until stdin is closed.

    Each message has `batch` samples at 1 kHz. The line "publishes" is printed when all sessions are
    open. At the end, the delay behind the schedule is printed as JSON, and the process ends.
    """
    settings = StreamSettings(mode="client", listen=(), connect=(Endpoint.parse(endpoint),))
    rigs: list[tuple[object, StreamSender]] = []
    for _ in range(count):
        session = publisher_session(settings)
        sender = StreamSender(session, f"rig-{os.getpid()}-{len(rigs)}", 1.0, lambda line: None)
        names = tuple(f"channel_{k}_m" for k in range(FLEET_CHANNELS))
        sender.send("channels", Channels(1, names, ("m",) * FLEET_CHANNELS).content())
        rigs.append((session, sender))
    print("publishes", flush=True)
    ended = threading.Event()

    def wait_for_the_end() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait_for_the_end, daemon=True).start()
    values = np.zeros((batch, FLEET_CHANNELS), np.float32)
    row, due = 0, time.monotonic()
    period = batch * 1e-3
    while not ended.is_set():
        for number, (_, sender) in enumerate(rigs):
            # Real rigs are not synchronised, so messages are spread evenly over the period.
            wait = due + period * number / count - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            times = np.asarray((row + np.arange(batch)) * 1e-3, np.float64)
            sender.send("samples", Samples(1, row, 1, time.time_ns(), times, values).content())
            if row % 500 == 0:
                beat = {"heartbeat_s": 0.5, "sequences": dict(sender.sequences)}
                sender.send("heartbeat", beat)
        row += batch
        due += period
    print(json.dumps({"late_s": time.monotonic() - due}), flush=True)
    os._exit(0)


def fleet(seconds: float, port: int, count: int, batch: int) -> dict[str, Any]:
    """Publish the streams of many rigs through one router; return what one reader measured.

    Args:
        seconds: for how long is measured.
        port: of the router.
        count: number of rigs.
        batch: samples in a message.

    Returns:
        What `follow` printed; `router_cpu`, the processors that the router used; `late_s`, how much
        the latest publisher was behind its schedule.
    """
    endpoint = f"tcp/127.0.0.1:{port}"
    router = subprocess.Popen(
        [sys.executable, "-m", "tools.bench.stream", "--route", endpoint],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert router.stdout is not None
    router.stdout.readline()
    publish = [sys.executable, "-m", "tools.bench.stream", "--publish"]
    publishers = [
        subprocess.Popen(
            [*publish, endpoint, str(share), str(batch)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for share in shares(count, PUBLISHERS)
    ]  # fmt: skip
    for publisher in publishers:
        assert publisher.stdout is not None
        publisher.stdout.readline()
    before = _cpu_s(router.pid)
    begun = time.monotonic()
    found = json.loads(follower(endpoint, "client", seconds).communicate()[0])
    routing = (_cpu_s(router.pid) - before) / (time.monotonic() - begun)
    late = [json.loads(each.communicate("")[0])["late_s"] for each in publishers]
    router.communicate("")
    return {**found, "router_cpu": routing, "late_s": max(late)}


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def route(endpoint: str) -> None:
    """Run a router of the stream until stdin is closed; print the line "routes" once it runs."""
    settings = StreamSettings(mode="router", listen=(Endpoint.parse(endpoint),))
    with publisher_session(settings):
        print("routes", flush=True)
        sys.stdin.read()


def measured(seconds: float) -> str:
    """Run all measurements, and return their table in Markdown with sentences before and after."""
    lines = [
        f"{COLUMNS - 1} channels at 1 kHz in batches of {BATCH}, {seconds:g} s each, all on one "
        f"machine of {os.cpu_count()} processors; load average at the end LOAD.",
        "",
        "| | readers | sent to taken, p50 / p99, ms | sample to reader, p50 / p99, ms "
        "| rows lost |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for readers in (1, 10):
        found = one_rig(readers, seconds, 17600 + readers)
        rows = sum(one["batches"] * BATCH for one in found)
        lost = sum(one["missing"] for one in found)
        sent = np.max([one["sent_s"] for one in found], axis=0)
        taken = np.max([one["taken_s"] for one in found], axis=0)
        lines.append(
            f"| one rig | {readers} | {_ms(sent)} | {_ms(taken)} | {lost} of {lost + rows} |"
        )
    sentences = []
    for number, (count, batch) in enumerate(FLEETS):
        one = fleet(seconds, 17700 + number, count, batch)
        rows = one["batches"] * batch
        lines.append(
            f"| {one['alive']} rigs of {FLEET_CHANNELS} channels by one router, in batches of "
            f"{batch} | 1 | {_ms(one['sent_s'])} | | {one['missing']} of {one['missing'] + rows} |"
        )
        sentences.append(
            f"The reader of {one['alive']} rigs takes {one['batches'] / seconds:.0f} batches of "
            f"{batch} a second with {100 * one['cpu']:.0f} % of a processor, the router has "
            f"{100 * one['router_cpu']:.0f} %; publishers were "
            f"{1e3 * max(one['late_s'], 0.0):.0f} ms behind their schedule at the end."
        )
    lines += ["", *sentences]
    return "\n".join(lines).replace("LOAD", f"{os.getloadavg()[0]:.1f}") + "\n"


def _ms(pair: Any) -> str:
    return f"{1e3 * pair[0]:.1f} / {1e3 * pair[1]:.1f}"


def main() -> None:
    """Run the benchmark and print its tables; with `--page`, write them into that page too."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="how long, each time")
    parser.add_argument("--page", type=Path, help="page to put the tables into")
    parser.add_argument("--follow", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--publish", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--route", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.follow:
        follow(given.follow[0], given.follow[1], given.seconds)
    elif given.publish:
        publish_fleet(given.publish[0], int(given.publish[1]), int(given.publish[2]))
    elif given.route:
        route(given.route)
    else:
        text = measured(given.seconds)
        print(text)
        if given.page is not None:
            before, _, rest = given.page.read_text().partition(BEGIN_MARK)
            _, _, after = rest.partition(END_MARK)
            given.page.write_text(f"{before}{BEGIN_MARK}\n{text}{END_MARK}{after}")


if __name__ == "__main__":
    main()
