"""Writes `estimator/filters/covariance.py`: straight-line code for the thesis filters' covariance.

The model fixes which entries of the transition Jacobian may differ from zero (eqs. 4.19 and 6.20).
Therefore this program writes the products of eqs. 4.17 and 4.18 out once, without the zeros, for
the upper triangle of the symmetric covariance. Run `python -m tools.generate_covariance` after you
changed a pattern; with `--check` it only compares the committed file with what it would write.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ONE: Final = "1"
TARGET: Final = Path(__file__).resolve().parent.parent / "estimator" / "filters" / "covariance.py"
MEASUREMENTS: Final = ("position", "p1", "p2")


@dataclass(frozen=True)
class Pattern:
    """The sparsity of one filter: which Jacobian entries are not zero, which states are measured.

    Attributes:
        name: of the filter, with which the generated names begin.
        source: equation of the Jacobian.
        rows: for each state, its row of the Jacobian. A row maps the column of each entry that is
            not zero to the entry's name, or to `ONE` where the entry is 1.
        measured: for each row of H (position, p1, p2; eq. 4.23), the index of the measured state.
    """

    name: str
    source: str
    rows: tuple[dict[int, str], ...]
    measured: tuple[int, int, int]

    @property
    def size(self) -> int:
        """The number of states."""
        return len(self.rows)

    @property
    def entries(self) -> tuple[tuple[int, int, str], ...]:
        """Row, column and name of every entry that is neither zero nor one, row by row."""
        return tuple(
            (i, j, name)
            for i, row in enumerate(self.rows)
            for j, name in sorted(row.items())
            if name != ONE
        )


_SPOOL: Final = {0: ONE, 5: "a05"}
_PRESSURE_1: Final = {0: "a10", 1: "a11", 3: "a13", 4: "a14"}
_PRESSURE_2: Final = {0: "a20", 2: "a22", 3: "a23", 4: "a24"}
_POSITION: Final = {3: ONE, 4: "a34"}
_SPOOL_VELOCITY: Final = {0: "a50", 5: "a55"}

PATTERNS: Final = (
    Pattern(
        "thesis6",
        "eq. 4.19",
        (
            _SPOOL,
            _PRESSURE_1,
            _PRESSURE_2,
            _POSITION,
            {1: "a41", 2: "a42", 4: "a44"},
            _SPOOL_VELOCITY,
        ),
        (3, 1, 2),
    ),
    Pattern(
        "thesis7",
        "eq. 6.20",
        (
            _SPOOL,
            _PRESSURE_1,
            _PRESSURE_2,
            _POSITION,
            {1: "a41", 2: "a42", 4: ONE, 6: "a46"},
            _SPOOL_VELOCITY,
            {6: ONE},
        ),
        (3, 1, 2),
    ),
)


def _p(i: int, j: int) -> str:
    return f"p{min(i, j)}{max(i, j)}"


def sum_of_products(terms: list[tuple[str, str]], constant: str | None = None) -> str:
    """Return an expression, as source text, for the sum of products in nested fused multiply-adds.

    Args:
        terms: the two factors of each product; where the first is `ONE`, the second is added.
        constant: a further summand, which comes first.
    """
    plain = [factor for name, factor in terms if name == ONE]
    products = [(name, factor) for name, factor in terms if name != ONE]
    total = " + ".join(([constant] if constant else []) + plain)
    for name, factor in products:
        total = f"fma({name}, {factor}, {total})" if total else f"{name} * {factor}"
    return total


def _signature(pattern: Pattern) -> list[str]:
    return [
        '@njit(cache=True, error_model="numpy", forceinline=True)',
        f"def {pattern.name}_kalman_step(",
        "    predicted: Vector,",
        "    entries: Vector,",
        "    x: FloatArray,",
        "    P: FloatArray,",
        "    process_noise: Vector,",
        "    measurement_noise: Vector,",
        "    z_position: float,",
        "    z_p1: float,",
        "    z_p2: float,",
        "    out: FloatArray,",
        ") -> None:",
    ]


def _propagation(pattern: Pattern) -> list[str]:
    """Return the source lines of P = A P A' + Q (eq. 4.17) for the upper triangle of P."""
    n = pattern.size
    # Rows with many entries come first, so that the short rows serve as the right factor.
    order = sorted(range(n), key=lambda i: -len(pattern.rows[i]))
    lines: list[str] = []
    updated: list[str] = []
    for position, i in enumerate(order):
        later = order[position:]
        for k in sorted({k for j in later for k in pattern.rows[j]}):
            terms = [(name, _p(column, k)) for column, name in sorted(pattern.rows[i].items())]
            lines.append(f"m{i}{k} = {sum_of_products(terms)}")
        for j in later:
            terms = [(name, f"m{i}{k}") for k, name in sorted(pattern.rows[j].items())]
            noise = f"process_noise[{i}]" if i == j else None
            updated.append(f"{_p(i, j)} = {sum_of_products(terms, noise)}")
    return lines + updated


def _correction(pattern: Pattern) -> list[str]:
    """Return the source lines of the three scalar updates (eq. 4.18 with a diagonal R).

    The written code skips the update by a measurement that is NaN.
    """
    n = pattern.size
    lines: list[str] = []
    for row, (name, s) in enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)):
        lines += [
            f"if everywhere(z_{name} == z_{name}):",
            f"    inverse = 1.0 / ({_p(s, s)} + measurement_noise[{row}])",
            f"    deviation = (z_{name} - x{s}) * inverse",
        ]
        others = [i for i in range(n) if i != s]
        lines += [f"    x{i} = fma({_p(i, s)}, deviation, x{i})" for i in range(n)]
        lines += [f"    k{i} = -{_p(i, s)} * inverse" for i in others]
        lines += [
            f"    {_p(i, j)} = fma(k{i}, {_p(j, s)}, {_p(i, j)})"
            for i in others
            for j in others
            if j >= i
        ]
        # 1 - K is computed as R/S, which avoids the cancellation in P - K P.
        lines += [f"    kept = measurement_noise[{row}] * inverse"]
        lines += [f"    {_p(i, s)} = {_p(i, s)} * kept" for i in range(n)]
    return lines


def _kalman_step(pattern: Pattern) -> list[str]:
    n = pattern.size
    states = ", ".join(f"x{i}" for i in range(n))
    names = ", ".join(name for _, _, name in pattern.entries)
    body = [
        f'"""Propagate and correct x ({n},) and P ({n}, {n}) by one sample, both in place.',
        "",
        f"`predicted` is x(-) and `entries` the Jacobian of {pattern.source} in the order of",
        f"`{pattern.name.upper()}_ENTRIES`. `out` (9,) as in `estimator.filters.thesis`.",
        '"""',
        f"{states} = predicted",
        f"{names} = entries",
    ]
    body += [f"{_p(i, j)} = P[{i}, {j}]" for i in range(n) for j in range(i, n)]
    body += _propagation(pattern)
    for row, (name, s) in enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)):
        body.append(f"out[{row}] = z_{name} - x{s}")
    for row, (name, s) in enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)):
        variance = f"{_p(s, s)} + measurement_noise[{row}]"
        body.append(f"out[{row + 6}] = {variance} if everywhere(z_{name} == z_{name}) else np.nan")
    body += _correction(pattern)
    for row, (name, s) in enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)):
        body.append(f"out[{row + 3}] = z_{name} - x{s}")
    body += [f"x[{i}] = x{i}" for i in range(n)]
    for i in range(n):
        body.append(f"P[{i}, {i}] = {_p(i, i)}")
        body += [f"P[{i}, {j}] = P[{j}, {i}] = {_p(i, j)}" for j in range(i + 1, n)]
    return _signature(pattern) + [f"    {line}" if line else "" for line in body]


def _entry_table(pattern: Pattern) -> list[str]:
    pairs = [f"    ({i}, {j})," for i, j, _ in pattern.entries]
    return [f"{pattern.name.upper()}_ENTRIES: Final = (", *pairs, ")"]


HEADER: Final = '''\
"""Straight-line covariance steps of the thesis filters: written by a program, not by hand.

Change `tools/generate_covariance.py` and run `python -m tools.generate_covariance`.
Products are fused multiply-adds by name, so that no compiler decides about rounding. Only the
upper triangle of P is read and both triangles are stored equal: an unsymmetrised P breaks down
within some hundred steps under the forward-Euler mode of the oil column.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import everywhere

from .fused import fma

FloatArray = NDArray[np.float64]
Vector = tuple[float, ...]

# Row and column of every Jacobian entry that is neither zero nor one, in the order of `entries`.
'''


def source() -> str:
    """Return the text of `estimator/filters/covariance.py`."""
    tables = [line for pattern in PATTERNS for line in _entry_table(pattern)]
    steps = [line for pattern in PATTERNS for line in ["", "", *_kalman_step(pattern)]]
    return HEADER + "\n".join(tables + steps) + "\n"


def main() -> int:
    """Write the module and return 0; with `--check`, write nothing and return 1 if it is stale."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare only, exit 1 if stale")
    if parser.parse_args().check:
        return 0 if TARGET.read_text(encoding="utf-8") == source() else 1
    TARGET.write_text(source(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
