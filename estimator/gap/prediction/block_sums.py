"""This module sums what disturbances change in a linearised course, block by block."""

from collections.abc import Sequence

import numpy as np

from estimator.gap.plant import Array

from .linear import HUBER
from .sensitivities import Course


def weights_of(course: Course) -> Array:
    """Return the weights (m, outputs) of squared innovations, less for outliers (Huber)."""
    return np.asarray(
        np.minimum(1.0, HUBER / np.maximum(np.abs(course.innovations), 1e-12)), np.float64
    )


class BlockSums:
    """Sums products of what is changed in a course's innovations, weighted against outliers.

    Args:
        course: the course.
        known: float64 (m, outputs, variables), what variables that were fitted change in it.
        blocks: the blocks that count, as slices of its samples, at least one.

    Attributes:
        products: float64 (blocks, variables, variables), products of their changes with each other.
        slopes: float64 (blocks, variables), products of their changes with the innovations.
        squares: float64 (blocks,), squares of the innovations.
        used: number of readings used in the blocks.
    """

    def __init__(self, course: Course, known: Array, blocks: Sequence[slice]) -> None:
        self._course, self._blocks = course, blocks
        weights = weights_of(course)
        root = np.sqrt(weights)
        # What is divided by the roots of these is weighted.
        self._variances = course.variances / weights
        self._left = np.stack([(course.innovations[b] * root[b]).ravel() for b in blocks])
        self._known = np.stack(
            [(known[b] * root[b][..., None]).reshape(self._left.shape[1], -1) for b in blocks]
        )
        turned = self._known.transpose(0, 2, 1)
        self.products = np.matmul(turned, self._known)
        self.slopes = np.matmul(turned, self._left[..., None])[..., 0]
        self._buffer = np.empty(0)
        self.squares = np.square(self._left).sum(1)
        self.used = sum(int(np.isfinite(course.variances[b]).sum()) for b in blocks)

    def answers(self, rows: Sequence[int], rates: Array, shapes: Array) -> Array:
        """Return what kicks change in the weighted innovations, (m, outputs, columns).

        The result holds until the next call: to get a new array of that size from the system takes
        longer than to fill it. The arguments are those of `Course.answers`, with (m, rows) rates.
        """
        course = self._course
        size = course.innovations.size * shapes.shape[1]
        if self._buffer.size < size:
            self._buffer = np.empty(size)
        kicked = np.flatnonzero(rates.any(axis=0))
        found = self._buffer[:size].reshape(*course.innovations.shape, shapes.shape[1])
        return course.answers(
            [rows[int(k)] for k in kicked], rates[:, kicked, None], shapes, self._variances, found
        )

    def in_blocks(self, rows: Sequence[int], rates: Array, shapes: Array) -> Array:
        """Return what `answers` does, in each block: (blocks, samples, outputs, columns)."""
        answers = self.answers(rows, rates, shapes)
        return np.stack([answers[block] for block in self._blocks])

    def summed(
        self, rows: Sequence[int], rates: Array, shapes: Array, counts: Sequence[int]
    ) -> list[tuple[Array, Array]]:
        """Return the sums over each block for groups of shapes.

        Args:
            rows: as in `answers`.
            rates: as in `answers`.
            shapes: float64 (m, columns), the shapes of all groups.
            counts: number of columns of each group, in their order.

        Returns:
            For each group float64 (blocks, k, k), products of the variables and the group's shapes
            with each other, and (blocks, k), those with the innovations; the variables come first.
        """
        answers, base = self.answers(rows, rates, shapes), self._known.shape[2]
        ends = np.cumsum([0, *counts])
        groups = [slice(ends[k], ends[k + 1]) for k in range(len(counts))]
        found = []
        for count in counts:
            products = np.empty((len(self._blocks), base + count, base + count))
            products[:, :base, :base] = self.products
            slopes = np.empty((len(self._blocks), base + count))
            slopes[:, :base] = self.slopes
            found.append((products, slopes))
        for b, block in enumerate(self._blocks):
            every = answers[block].reshape(self._left.shape[1], -1)
            with_known, with_left = every.T @ self._known[b], self._left[b] @ every
            for own, (products, slopes) in zip(groups, found, strict=True):
                products[b, base:, :base] = with_known[own]
                products[b, :base, base:] = with_known[own].T
                products[b, base:, base:] = every[:, own].T @ every[:, own]
                slopes[b, base:] = with_left[own]
        return found
