"""Shares the members of a load, such as readers, among processes."""


def shares(count: int, processes: int) -> list[int]:
    """Return the number of members in each process, as even as can be, for `count` members.

    There are at most `processes` numbers, all of them at least 1; their sum is `count`.
    """
    used = min(count, processes)
    return [count // used + (place < count % used) for place in range(used)]
