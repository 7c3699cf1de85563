"""The generated covariance code is the one its generator writes."""

from tools.generate_covariance import PATTERNS, TARGET, Pattern, source


def test_the_committed_module_is_what_the_generator_writes() -> None:
    assert TARGET.read_text(encoding="utf-8") == source()


def test_the_patterns_have_the_rows_of_the_printed_jacobians() -> None:
    """Nonzero entries by row in eqs. 4.19 and 6.20."""
    nonzero = {pattern.name: [len(row) for row in pattern.rows] for pattern in PATTERNS}
    assert nonzero == {"thesis6": [2, 4, 4, 2, 3, 2], "thesis7": [2, 4, 4, 2, 4, 2, 1]}


def test_entries_are_listed_row_by_row() -> None:
    pattern = Pattern("any", "", ({1: "a01", 0: "1"}, {1: "a11", 0: "a10"}), (0, 1, 0))
    assert pattern.entries == ((0, 1, "a01"), (1, 0, "a10"), (1, 1, "a11"))
