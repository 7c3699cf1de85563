"""Leak tests of rigs drawn at random."""

from tools.leak_test.trials import scored


def test_a_leak_of_a_thousandth_of_a_litre_a_minute_is_found_on_drawn_rigs() -> None:
    assert scored("external_leakage_1", 0.001, 10, 5).found >= 9


def test_drawn_rigs_without_a_leak_are_not_accused() -> None:
    assert scored("healthy", 0.0, 10, 5).found == 0
