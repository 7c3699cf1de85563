import pytest

from tools.bench.shares import shares


@pytest.mark.parametrize(
    ("count", "expected"),
    [(0, []), (1, [1]), (3, [1, 1, 1]), (5, [1] * 5), (7, [2, 2, 1, 1, 1]), (50, [10] * 5)],
)
def test_no_member_is_lost_and_no_process_is_idle(count: int, expected: list[int]) -> None:
    assert shares(count, 5) == expected
