"""Write `estimator/filters/thesis_ud.py`: a step of the seven-state thesis filter on factors.

The pattern is that of `tools.generate_covariance`; the covariance is kept as U and D of
P = U D U^T (`estimator.filters.ud`). Rows of A U and one column of noise a state are orthogonalised
with the zeros left out, then three measurements correct. Run `python -m tools.generate_ud` after
changing a pattern; `--check` only says whether the committed file is in step.
"""

import argparse
from pathlib import Path
from typing import Final

from .generate_covariance import MEASUREMENTS, ONE, PATTERNS, Pattern, sum_of_products

TARGET: Final = Path(__file__).resolve().parent.parent / "estimator" / "filters" / "thesis_ud.py"
PATTERN: Final = next(pattern for pattern in PATTERNS if pattern.name == "thesis7")

Row = dict[str, str]
"""A sparse row of W: the expression in each column that is not zero."""


def _u(i: int, j: int) -> str:
    return f"u{i}{j}"


def _rows(pattern: Pattern) -> tuple[list[str], list[Row]]:
    """Emit A U, and return its rows with a column of noise each (columns c0..., n0...)."""
    n = pattern.size
    lines: list[str] = []
    rows: list[Row] = []
    for i in range(n):
        row: Row = {}
        for j in range(n):
            # U has ones on its diagonal: they leave the entry of A alone, or a one.
            terms = []
            for k, entry in sorted(pattern.rows[i].items()):
                if k == j:
                    terms.append((ONE, entry) if entry != ONE else (ONE, "1.0"))
                elif k < j:
                    terms.append((entry, _u(k, j)))
            if not terms:
                continue
            if len(terms) == 1 and terms[0][0] == ONE:
                row[f"c{j}"] = terms[0][1]
            else:
                row[f"c{j}"] = f"w{i}c{j}"
                lines.append(f"w{i}c{j} = {sum_of_products(terms)}")
        row[f"n{i}"] = "1.0"
        rows.append(row)
    return lines, rows


def _weight(column: str) -> str:
    kind, index = column[0], column[1:]
    return f"d{index}" if kind == "c" else f"process_noise[{index}]"


def _times(a: str, b: str) -> str:
    if a == "1.0":
        return b
    return a if b == "1.0" else f"{a} * {b}"


def _prediction(pattern: Pattern) -> list[str]:
    """Emit the factors of A P A' + Q (eq. 4.17): modified weighted Gram-Schmidt, last row first."""
    lines, rows = _rows(pattern)
    for j in range(pattern.size - 1, -1, -1):
        row = rows[j]
        weighted = {}
        for column, entry in row.items():
            name = _times(entry, _weight(column))
            if entry != "1.0":
                lines.append(f"v{column} = {name}")
                name = f"v{column}"
            weighted[column] = name
        # The old factors are needed to the end: the new ones have names of their own.
        lines += _dot(f"e{j}", [(weighted[column], entry) for column, entry in row.items()])
        if j:
            lines.append(f"inverse = 1.0 / e{j}")
        for i in range(j):
            common = [column for column in row if column in rows[i]]
            share = f"t{i}{j}"
            if not common:
                lines.append(f"{share} = 0.0")
                continue
            lines += _dot("total", [(weighted[column], rows[i][column]) for column in common])
            lines.append(f"{share} = total * inverse")
            for column, entry in row.items():
                rest = rows[i].get(column)
                product = f"fma(-{share}, {entry}, {rest})"
                if entry == "1.0":
                    product = f"{rest} - {share}"
                if rest is None:
                    product = f"-{_times(share, entry)}"
                lines.append(f"w{i}{column} = {product}")
                rows[i][column] = f"w{i}{column}"
    lines += [f"d{i} = e{i}" for i in range(pattern.size)]
    return lines + [f"{_u(i, j)} = t{i}{j}" for j in range(pattern.size) for i in range(j)]


def _dot(name: str, terms: list[tuple[str, str]]) -> list[str]:
    """Emit the sum of products, a fused multiply-add a line."""
    (a, b), *others = terms
    lines = [f"{name} = {_times(a, b)}"]
    for a, b in others:
        lines.append(f"{name} = {name} + {a}" if b == "1.0" else f"{name} = fma({a}, {b}, {name})")
    return lines


def _variance(pattern: Pattern, row: int, name: str) -> list[str]:
    """Emit the innovation's variance of a measurement: P of its state plus R."""
    s = pattern.measured[row]
    lines = [f"total = d{s} + measurement_noise[{row}]"]
    for j in range(s + 1, pattern.size):
        lines.append(f"total = fma({_u(s, j)} * {_u(s, j)}, d{j}, total)")
    return [*lines, f"out[{row + 6}] = total if everywhere(z_{name} == z_{name}) else np.nan"]


def _correction(pattern: Pattern) -> list[str]:
    """Emit Bierman's three scalar corrections (eq. 4.18), each skipped if z is NaN."""
    n = pattern.size
    lines: list[str] = []
    for row, (name, s) in enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)):
        lines += [
            f"if everywhere(z_{name} == z_{name}):",
            f"    before = measurement_noise[{row}]",
            f"    expected = before + d{s}",
            "    inverse = 1.0 / expected",
            f"    k{s} = d{s}",
            f"    d{s} = d{s} * before * inverse",
        ]
        # The gain so far; a column at s or before it has none above the state measured.
        lines += [f"    k{i} = k{s} * {_u(i, s)}" for i in range(s)]
        for j in range(s + 1, n):
            lines += [
                f"    f = {_u(s, j)}",
                f"    g = d{j} * f",
                "    slope = -f * inverse",
                "    before = expected",
                "    expected = fma(f, g, before)",
                "    inverse = 1.0 / expected",
                f"    d{j} = d{j} * before * inverse",
            ]
            for i in range(j):
                lines += [
                    f"    u = {_u(i, j)}",
                    f"    {_u(i, j)} = fma(slope, k{i}, u)",
                    f"    k{i} = fma(g, u, k{i})",
                ]
            lines.append(f"    k{j} = g")
        lines.append(f"    deviation = (z_{name} - x{s}) * inverse")
        lines += [f"    x{i} = fma(k{i}, deviation, x{i})" for i in range(n)]
    return lines


def _step(pattern: Pattern) -> list[str]:
    n = pattern.size
    states = ", ".join(f"x{i}" for i in range(n))
    names = ", ".join(name for _, _, name in pattern.entries)
    body = [
        f'"""Propagate and correct x ({n},) and factors ({n}, {n}) by one sample, both in place.',
        "",
        f"Arguments as `{pattern.name}_kalman_step`, with factors of P (`estimator.filters.ud`).",
        '"""',
        f"{states} = predicted",
        f"{names} = entries",
        *(f"d{j} = factors[{j}, {j}]" for j in range(n)),
        *(f"{_u(i, j)} = factors[{j}, {i}]" for j in range(n) for i in range(j)),
        *_prediction(pattern),
    ]
    measured = list(enumerate(zip(MEASUREMENTS, pattern.measured, strict=True)))
    body += [f"out[{row}] = z_{name} - x{s}" for row, (name, s) in measured]
    body += [line for row, (name, _) in measured for line in _variance(pattern, row, name)]
    body += _correction(pattern)
    body += [f"out[{row + 3}] = z_{name} - x{s}" for row, (name, s) in measured]
    body += [f"x[{i}] = x{i}" for i in range(n)]
    body += [f"factors[{j}, {j}] = d{j}" for j in range(n)]
    body += [f"factors[{j}, {i}] = {_u(i, j)}" for j in range(n) for i in range(j)]
    return [
        '@njit(cache=True, error_model="numpy", forceinline=True)',
        f"def {pattern.name}_ud_step(",
        "    predicted: Vector,",
        "    entries: Vector,",
        "    x: FloatArray,",
        "    factors: FloatArray,",
        "    process_noise: Vector,",
        "    measurement_noise: Vector,",
        "    z_position: float,",
        "    z_p1: float,",
        "    z_p2: float,",
        "    out: FloatArray,",
        ") -> None:",
        *(f"    {line}" if line else "" for line in body),
    ]


HEADER: Final = '''\
"""A straight-line step of the seven-state thesis filter in UD form: written by a program.

Change `tools/generate_ud.py` and run `python -m tools.generate_ud`. Products are fused
multiply-adds by name, so that no compiler decides about rounding.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.lanes import everywhere

from .fused import fma

FloatArray = NDArray[np.float64]
Vector = tuple[float, ...]


'''


def source() -> str:
    """Return the text of `estimator/filters/thesis_ud.py`."""
    return HEADER + "\n".join(_step(PATTERN)) + "\n"


def main() -> int:
    """Write the module, or with `--check` report whether the committed one is in step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare only, exit 1 if stale")
    if parser.parse_args().check:
        return 0 if TARGET.read_text(encoding="utf-8") == source() else 1
    TARGET.write_text(source(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
