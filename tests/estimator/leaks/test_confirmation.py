"""A leak is confirmed and gone by what the accounts show, not by what they cannot show."""

import pytest

from estimator.leaks.confirmation import CONFIRMED_AFTER_S, PresentLeaks
from estimator.leaks.finding import Finding
from rig.plant import FAULTS

LEAK, OTHER, LINE = 0, 2, FAULTS.index("supply_leakage")
SURE = {FAULTS[LEAK]: 1.0}
HEALTHY = {"healthy": 1.0}


def finding(fault: int, coefficient: float = 5e-9) -> Finding:
    return Finding(fault, 0, coefficient, 1e-10, 20.0, 400.0, 8.0, 1.0)


class Confirmation:
    """Asks every half second, as the detector does; its verdicts say what they are told."""

    def __init__(self) -> None:
        self.left: dict[int, float] = {}
        self.time_s = 10.0
        self.leaks = PresentLeaks(lambda f: self.left.get(f.fault, f.coefficient))

    def after(
        self, seconds: float, faults: tuple[int, ...] = (), probabilities: dict[str, float] = SURE
    ) -> tuple[float, float, float]:
        for _ in range(round(2.0 * seconds)):
            self.time_s += 0.5
            found = [finding(fault) for fault in faults]
            present = self.leaks.update(self.time_s, found, probabilities)
        return present


@pytest.fixture
def confirmed() -> Confirmation:
    """A leak that has just been confirmed."""
    confirmation = Confirmation()
    assert not any(confirmation.after(CONFIRMED_AFTER_S, (LEAK,)))
    assert confirmation.after(0.5, (LEAK,)) == (5e-9, 0.0, 0.0)
    return confirmation


def test_a_leak_stays_while_nothing_is_found(confirmed: Confirmation) -> None:
    assert confirmed.after(60.0) == (5e-9, 0.0, 0.0)
    assert not confirmed.leaks.ended(confirmed.time_s)


def test_a_leak_goes_when_the_accounts_show_its_end(confirmed: Confirmation) -> None:
    confirmed.left[LEAK] = 0.0
    assert not any(confirmed.after(0.5))
    confirmed.left.clear()
    assert not any(confirmed.after(20.0))


def test_a_leak_whose_end_proves_wrong_is_there_again(confirmed: Confirmation) -> None:
    confirmed.left[LEAK] = 0.0
    assert not any(confirmed.after(1.0, (LEAK,)))
    confirmed.left.clear()
    assert confirmed.after(0.5, (LEAK,)) == (5e-9, 0.0, 0.0)
    assert not confirmed.leaks.ended(confirmed.time_s + 60.0)


@pytest.mark.parametrize("likely", [HEALTHY, {FAULTS[OTHER]: 0.9, FAULTS[LEAK]: 0.1}])
def test_a_leak_that_is_not_likely_any_more_goes(
    confirmed: Confirmation, likely: dict[str, float]
) -> None:
    assert not any(confirmed.after(0.5, (), likely))


def test_one_of_two_leaks_is_not_dropped_for_the_other() -> None:
    both = Confirmation()
    both.after(CONFIRMED_AFTER_S + 0.5, (LEAK, OTHER))
    assert both.after(3.0, (LEAK,), {"multiple": 0.9}) == (5e-9, 0.0, 5e-9)


def test_each_leak_needs_its_own_confirmation(confirmed: Confirmation) -> None:
    assert confirmed.after(CONFIRMED_AFTER_S, (LEAK, OTHER)) == (5e-9, 0.0, 0.0)
    assert confirmed.after(0.5, (LEAK, OTHER)) == (5e-9, 0.0, 5e-9)


def test_a_fault_of_the_lines_is_no_leak() -> None:
    assert not any(Confirmation().after(60.0, (LINE,)))


def test_leaks_have_ended_once_they_were_gone_for_as_long_again(
    confirmed: Confirmation,
) -> None:
    # The test goes on finding it, since its onset, and that it is not there any more.
    confirmed.left[LEAK] = 0.0
    confirmed.after(CONFIRMED_AFTER_S, (LEAK,))
    assert not confirmed.leaks.ended(confirmed.time_s)
    confirmed.after(0.5, (LEAK,))
    assert confirmed.leaks.ended(confirmed.time_s)


@pytest.mark.parametrize("fault", [OTHER, LINE])
def test_leaks_have_not_ended_while_they_may_have_been_something_else(
    confirmed: Confirmation, fault: int
) -> None:
    confirmed.after(10.0, (fault,), {FAULTS[fault]: 1.0})
    assert not confirmed.leaks.ended(confirmed.time_s)


def test_what_explains_leaks_that_have_ended_is_not_confirmed(confirmed: Confirmation) -> None:
    confirmed.left[LEAK] = 0.0
    confirmed.after(0.5, (LEAK,))
    assert not any(confirmed.after(10.0, (OTHER,)))
    assert confirmed.leaks.ended(confirmed.time_s)


def test_nothing_ends_that_was_not_confirmed() -> None:
    never = Confirmation()
    never.after(3.0, (LEAK,))
    never.after(60.0, (), HEALTHY)
    assert not never.leaks.ended(never.time_s)
