"""Each role may do what the roles below it may, and nobody is kept from stopping."""

import pytest

from rig.accounts import Role, refusals, why_not
from rig.accounts.roles import NEEDED
from rig.console.orders import ORDERS


def test_the_table_has_every_order_of_the_page() -> None:
    assert set(ORDERS) <= set(NEEDED)


@pytest.mark.parametrize("role", Role)
def test_everybody_may_stop(role: Role) -> None:
    assert why_not("stop", role) == ""


def test_a_viewer_may_stop_only_an_operator_run_and_an_engineer_change() -> None:
    assert set(NEEDED) - set(refusals(Role.VIEWER)) == {"stop"}
    assert set(refusals(Role.OPERATOR)) == {"set"}
    assert refusals(Role.ENGINEER) == {}
    assert why_not("hold", Role.VIEWER) == "this needs the role operator; yours is viewer"


def test_an_order_that_the_table_has_not_is_the_highest_role_s() -> None:
    assert why_not("rewire", Role.OPERATOR)
    assert not why_not("rewire", Role.ENGINEER)
