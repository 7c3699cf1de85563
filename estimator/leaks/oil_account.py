"""The oil account together with its test, which supplies the null bias for the next block."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import AccountBlock, FlowAccount
from rig.plant import Parameters

from .leak_statistic import LeakTest

Array = NDArray[np.float64]


class OilAccount:
    """Keeps the account of both chambers and passes every finished block to a test.

    Which edges of the valve are open depends on the spool's null bias. It is taken from the test,
    which fits a constant to all blocks so far and knows its uncertainty; the filter's estimate
    would start from nothing and follow leaks. The result does not depend on how samples are
    batched.

    Args:
        parameters: the parameters of the rig that are assumed.
        test: the test that takes every block.
    """

    def __init__(self, parameters: Parameters, test: LeakTest) -> None:
        self.test = test
        self._account = FlowAccount(parameters)
        self._assumed_bias = parameters.spool_null_bias
        self._further_bias = test.null_bias()

    def add(
        self,
        time_s: Array,
        spool: Array,
        p1: Array,
        p2: Array,
        position: Array,
        fresh: Array,
        supply: Array,
    ) -> Iterator[AccountBlock]:
        """Add samples (arguments as for `FlowAccount.add`); yield each block once it is tested.

        The samples are added while the blocks are iterated over. Incomplete blocks, which the test
        ignores, are yielded too.
        """
        first = 0
        while first < time_s.size:
            part = slice(first, first + self._account.samples_left)
            further_bias, spread = self._further_bias
            blocks = self._account.add(
                time_s[part], spool[part], p1[part], p2[part], position[part], fresh[part],
                supply=supply[part],
                null_bias=self._assumed_bias + further_bias,
                null_spread=spread,
            )  # fmt: skip
            for block in blocks:
                self.test.add(block)
                self._further_bias = self.test.null_bias()
                yield block
            first = part.stop
