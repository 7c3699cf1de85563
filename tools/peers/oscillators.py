"""Oscillators whose acceleration has a hidden term, drawn from a grammar and simulated finely.

    q'' = drive - stiffness q - damping q' + hidden(q, q')

A hidden term is one form of `FORMS`, or the sum of two. It is scaled so that its root mean square
along the motion is a stated part of that of the drive. The simulation shares no code with the
product: Runge and Kutta of the fourth order in steps of 50 us, the drive held for a millisecond.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, exp, pi, sin, tanh
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]
Term = Callable[[float, float], float]

PLANT: Final = f"{Path(__file__).with_name('oscillator_plant.py')}:oscillator"
"""`--plant` of `rig gap`."""
NOISE: Final = 1e-4
"""Standard deviation of the noise of a reading, rad."""
TICK: Final = 1e-3
STEPS: Final = 20
SECONDS: Final = {"identify_1": 10.0, "identify_2": 10.0, "holdout": 6.0}
SIZES: Final = (0.05, 0.3)
"""Least and greatest root mean square of the hidden term, as a part of that of the drive."""
LEAST: Final = 1e-3
"""A form whose root mean square along the motion is less counts as of this one."""
_SHARE_OF_TWO: Final = 0.4
"""How often the hidden term is a sum of two forms."""
_STIFFNESS: Final = 60.0
_DAMPING: Final = 1.2


@dataclass(frozen=True)
class Form:
    """One form of the grammar.

    Attributes:
        text: the form in symbols; `#` stands for the parameter that is drawn.
        of: the quantities on which it depends, by the names of the plant's regions.
        low: least parameter.
        high: greatest parameter.
        term: parameter -> the form as a function of q (rad) and q' (rad/s), at a size of one.
    """

    text: str
    of: tuple[str, ...]
    low: float
    high: float
    term: Callable[[float], Term]


FORMS: Final = (
    Form("q^2", ("position",), 0, 0, lambda a: lambda q, v: q * q),
    Form("q^3", ("position",), 0, 0, lambda a: lambda q, v: q**3),
    Form("q |q|", ("position",), 0, 0, lambda a: lambda q, v: q * abs(q)),
    Form("sin(# q)", ("position",), 2.0, 8.0, lambda a: lambda q, v: sin(a * q)),
    Form("max(0, q - #)", ("position",), -0.1, 0.15, lambda a: lambda q, v: max(0.0, q - a)),
    Form("exp(-(q/#)^2)", ("position",), 0.1, 0.3, lambda a: lambda q, v: exp(-((q / a) ** 2))),
    Form("v |v|", ("velocity",), 0, 0, lambda a: lambda q, v: v * abs(v)),
    Form("v^3", ("velocity",), 0, 0, lambda a: lambda q, v: v**3),
    Form("v^2", ("velocity",), 0, 0, lambda a: lambda q, v: v * v),
    Form("|v|^# sgn(v)", ("velocity",), 0.3, 0.7,
         lambda a: lambda q, v: copysign(abs(v) ** a, v)),
    Form("tanh(v/#)", ("velocity",), 0.02, 0.1, lambda a: lambda q, v: tanh(v / a)),
    Form("tanh(20 v) exp(-(v/#)^2)", ("velocity",), 0.5, 2.0,
         lambda a: lambda q, v: tanh(20.0 * v) * exp(-((v / a) ** 2))),
    Form("q v", ("position", "velocity"), 0, 0, lambda a: lambda q, v: q * v),
    Form("q^2 v", ("position", "velocity"), 0, 0, lambda a: lambda q, v: q * q * v),
    Form("q |v|", ("position", "velocity"), 0, 0, lambda a: lambda q, v: q * abs(v)),
    Form("tanh(v/0.05) |q|", ("position", "velocity"), 0, 0,
         lambda a: lambda q, v: tanh(v / 0.05) * abs(q)),
)  # fmt: skip
"""The forms that can be hidden: polynomials, drag, friction, hinges, waves, bumps and products."""


@dataclass(frozen=True)
class Hidden:
    """A hidden term.

    Attributes:
        forms: form and its parameter, one or two.
        sizes: coefficient of each, rad/s^2 for a form of one.
    """

    forms: tuple[tuple[Form, float], ...]
    sizes: tuple[float, ...]

    @property
    def text(self) -> str:
        """The term in symbols."""
        parts = [
            f"{size:+.3g} {form.text.replace('#', f'{a:.2g}')}"
            for (form, a), size in zip(self.forms, self.sizes, strict=True)
        ]
        return " ".join(parts)

    @property
    def of(self) -> tuple[str, ...]:
        """The quantities on which the term depends."""
        return tuple(dict.fromkeys(name for form, _ in self.forms for name in form.of))

    def terms(self) -> list[tuple[float, Term]]:
        """Return each size with its form as a function."""
        return [
            (size, form.term(a)) for (form, a), size in zip(self.forms, self.sizes, strict=True)
        ]


def drive(rng: Generator, rows: int) -> Array:
    """Return a drive (rows,), rad/s^2: twelve sines of 0.1 to 4 Hz, and steps."""
    time = np.arange(rows) * TICK
    found = np.zeros(rows)
    for frequency in rng.uniform(0.1, 4.0, 12):
        found += rng.uniform(0.5, 2.0) * np.sin(2 * pi * (frequency * time + rng.random()))
    steps = rng.uniform(-20.0, 20.0, rows // 800 + 1)
    return np.asarray(5.0 * found / 3.0 + np.repeat(steps, 800)[:rows])


def simulated(
    stiffness: float, damping: float, hidden: Hidden, push: Array, start: tuple[float, float]
) -> Array:
    """Return angle and velocity (n, 2) of an oscillator at each tick of a drive (n,)."""
    terms = hidden.terms()

    def rate(q: float, v: float, u: float) -> float:
        found = u - stiffness * q - damping * v
        for size, term in terms:
            found += size * term(q, v)
        return found

    h = TICK / STEPS
    q, v = start
    found = np.empty((len(push), 2))
    for row, u in enumerate(push.tolist()):
        found[row] = q, v
        for _ in range(STEPS):
            a1 = rate(q, v, u)
            q2, v2 = q + 0.5 * h * v, v + 0.5 * h * a1
            a2 = rate(q2, v2, u)
            q3, v3 = q + 0.5 * h * v2, v + 0.5 * h * a2
            a3 = rate(q3, v3, u)
            q4, v4 = q + h * v3, v + h * a3
            q += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + rate(q4, v4, u))
    return found


def drawn(seed: int, number: int) -> tuple[Hidden, float, float, dict[str, Array]]:
    """Return what is hidden in an oscillator, its stiffness (1/s^2), damping (1/s), and drives."""
    rng = np.random.default_rng([seed, number])
    # Each form comes once before any comes again.
    order = np.random.default_rng([seed, number // len(FORMS), 7]).permutation(len(FORMS))
    chosen = [FORMS[order[number % len(FORMS)]]]
    if rng.random() < _SHARE_OF_TWO:
        others = [form for form in FORMS if form is not chosen[0]]
        chosen.append(others[int(rng.integers(len(others)))])
    stiffness, damping = (
        value * (1.0 + share * rng.uniform(-1.0, 1.0))
        for value, share in ((_STIFFNESS, 0.05), (_DAMPING, 0.15))
    )
    drives = {name: drive(rng, round(seconds / TICK)) for name, seconds in SECONDS.items()}
    forms = tuple((form, float(rng.uniform(form.low, form.high))) for form in chosen)
    # Sizes are by the motion without the hidden term; it must not drive the oscillator away.
    push = drives["identify_1"]
    motion = simulated(stiffness, damping, Hidden((), ()), push, (0.0, 0.0))[::50]
    sizes = []
    for form, a in forms:
        term = form.term(a)
        along = max(float(np.sqrt(np.mean([term(q, v) ** 2 for q, v in motion]))), LEAST)
        part = exp(rng.uniform(np.log(SIZES[0]), np.log(SIZES[1])))
        gained = float(np.mean([term(q, v) * v for q, v in motion]))
        hardens = float(np.mean([term(q, v) * q for q, v in motion]))
        sign = -1.0 if gained + hardens > 0.0 else 1.0
        sizes.append(sign * part * float(push.std()) / along)
    return Hidden(forms, tuple(sizes)), stiffness, damping, drives


def written(seed: int, number: int, folder: Path) -> tuple[Hidden, dict[str, Path], Path]:
    """Simulate an oscillator, and write its recordings and its model to a folder.

    Returns:
        What is hidden in it, the recordings by the names of `SECONDS`, and the model file, which
        has the known part.
    """
    hidden, stiffness, damping, drives = drawn(seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng([seed, number, 1])
    files = {}
    for name, push in drives.items():
        motion = simulated(stiffness, damping, hidden, push, (0.0, 0.0))
        read = motion[:, 0] + NOISE * noise.standard_normal(len(push))
        table = np.column_stack([np.arange(len(push)) * TICK, push, read])
        files[name] = folder / f"{name}.csv"
        np.savetxt(
            files[name], table, fmt=("%.3f", "%.9g", "%.9g"), delimiter=",", comments="",
            header="time_s,drive,position_rad",
        )  # fmt: skip
    model = folder / "oscillator.yaml"
    model.write_text(
        "name: oscillator\n"
        f"parameters: {{stiffness: {_STIFFNESS:g} 1/s^2, damping: {_DAMPING:g} 1/s}}\n",
        encoding="utf-8",
    )
    return hidden, files, model
