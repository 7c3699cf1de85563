"""A process that may open no more files still finds its way out, or refuses to begin."""

import errno
import os
import resource

import pytest

from rig.reserves import KEPT, NEEDED, Reserve, ShortageError, remedy_for

LIMITS = {resource.RLIMIT_NOFILE: (10_000, 10_000), resource.RLIMIT_AS: (-1, -1)}


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> dict[int, tuple[int, int]]:
    """The limits of this process as the code under test sees and sets them."""
    given = dict(LIMITS)
    monkeypatch.setattr("resource.getrlimit", given.__getitem__)
    monkeypatch.setattr("resource.setrlimit", given.__setitem__)
    return given


def used() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_descriptors_are_kept_and_given_back_once(limits: dict[int, tuple[int, int]]) -> None:
    before = used()
    reserve = Reserve()
    reserve.take()
    assert used() == before + KEPT
    reserve.release()
    reserve.release()
    assert used() == before


def test_with_three_descriptors_left_a_session_does_not_begin(
    limits: dict[int, tuple[int, int]],
) -> None:
    limits[resource.RLIMIT_NOFILE] = (used() + 2, used() + 2)
    with pytest.raises(ShortageError, match=rf"are left; .* needs {NEEDED}; .* `ulimit -n \d+`"):
        Reserve().take()


def test_a_low_limit_that_may_be_raised_is_raised(limits: dict[int, tuple[int, int]]) -> None:
    limits[resource.RLIMIT_NOFILE] = (used() + 2, 10_000)
    reserve = Reserve()
    reserve.take()
    reserve.release()
    soft, hard = limits[resource.RLIMIT_NOFILE]
    assert used() + NEEDED <= soft <= used() + NEEDED + 2
    assert hard == 10_000


def test_with_little_address_space_a_session_does_not_begin(
    limits: dict[int, tuple[int, int]],
) -> None:
    limits[resource.RLIMIT_AS] = (1 << 30, 1 << 30)
    with pytest.raises(ShortageError, match=r"may have 1\.00 GiB of address space; .*ulimit -v"):
        Reserve().take()


@pytest.mark.parametrize(
    ("number", "remedy"),
    [(errno.EMFILE, "ulimit -n"), (errno.ENOMEM, "memory"), (errno.ENOSPC, "free space")],
)
def test_the_remedy_fits_what_is_short(number: int, remedy: str) -> None:
    assert remedy in remedy_for(OSError(number, ""))
