"""Oscillators are drawn by their seed alone, and simulated as SciPy does it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tools.peers.oscillators import FORMS, TICK, drawn, simulated

from .oscillating import hidden


def test_the_simulation_agrees_with_scipy() -> None:
    push = np.repeat([5.0, -8.0, 3.0], 100)
    term = hidden("q^3", -20.0)
    found = simulated(60.0, 1.2, term, push, (0.2, 0.0))
    state = np.array([0.2, 0.0])
    for first in (0, 100, 200):
        drive = push[first]
        solved = solve_ivp(
            lambda t, x, u=drive: (x[1], u - 60.0 * x[0] - 1.2 * x[1] - 20.0 * x[0] ** 3),
            (0.0, 100 * TICK), state, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        np.testing.assert_allclose(found[first], state, rtol=0.0, atol=1e-8)
        state = solved.y[:, -1]


def test_each_form_is_hidden_once_before_any_comes_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.peers.oscillators.SECONDS", {"identify_1": 1.0})
    first = [drawn(3, number)[0].forms[0][0].text for number in range(len(FORMS))]
    assert sorted(first) == sorted(form.text for form in FORMS)


def test_a_seed_draws_the_same_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.peers.oscillators.SECONDS", {"identify_1": 1.0})
    one, other = (drawn(3, 1) for _ in range(2))
    assert one[0] == other[0]
    np.testing.assert_array_equal(one[3]["identify_1"], other[3]["identify_1"])


@pytest.mark.parametrize("form", FORMS, ids=[form.text for form in FORMS])
def test_a_form_depends_on_the_quantities_that_it_names(form, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    term = form.term(form.high)
    at = [(0.4, 1.3), (0.9, 1.3), (0.4, 0.2)]
    here, moved, slower = (term(q, v) for q, v in at)
    assert ("position" in form.of) == (here != moved)
    assert ("velocity" in form.of) == (here != slower)
