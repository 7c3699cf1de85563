"""What the kernel refuses is reported with its remedy, and nothing fails for it."""

import ctypes
import errno
import os
import threading
from collections.abc import Callable
from typing import Any

import pytest

from rig.loop import realtime
from rig.loop.realtime import Grant, RealTime

pytestmark = pytest.mark.usefixtures("no_memory_locked")


def in_a_thread(work: Callable[[], tuple[Grant, ...]]) -> tuple[Grant, ...]:
    found: list[tuple[Grant, ...]] = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]


def asked(cpu: int | None = None, priority: int = 10) -> tuple[Grant, ...]:
    def ask() -> tuple[Grant, ...]:
        with RealTime(cpu, priority) as real_time:
            return real_time.grants

    return in_a_thread(ask)


@pytest.fixture
def no_privilege(no_memory_locked: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> Any:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    def fail(*_: Any) -> int:
        ctypes.set_errno(errno.ENOMEM)
        return -1

    class Libc:
        prctl = mlockall = staticmethod(fail)
        munlockall = staticmethod(lambda: 0)

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "open", refuse)
    monkeypatch.setattr(realtime, "_libc", Libc)


@pytest.mark.usefixtures("no_privilege")
def test_without_privilege_each_refusal_has_its_reason_and_remedy() -> None:
    grants = asked()
    assert [grant.granted for grant in grants] == [False] * 4
    for grant in grants:
        assert grant.why
        assert grant.remedy


def test_a_processor_that_is_not_there_is_refused() -> None:
    grant = asked(cpu=1000)[0]
    assert not grant.granted
    assert "loop: cpu" in grant.remedy


def test_what_is_granted_needs_no_remedy() -> None:
    assert all(not grant.remedy for grant in asked() if grant.granted)


def test_a_loop_that_asks_for_no_priority_is_not_told_of_it() -> None:
    assert not any("SCHED_FIFO" in grant.name for grant in asked(priority=0))


def test_afterwards_the_thread_is_an_ordinary_one_again() -> None:
    def ask() -> tuple[Grant, ...]:
        before = os.sched_getaffinity(0)
        cpu = min(before)
        with RealTime(cpu, 10) as real_time:
            grants = real_time.grants
        assert os.sched_getaffinity(0) == before
        assert os.sched_getscheduler(0) == os.SCHED_OTHER
        return grants

    assert in_a_thread(ask)
