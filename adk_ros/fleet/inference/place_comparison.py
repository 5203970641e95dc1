# Copyright 2026 The adk_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Which effect it is that acts at a place: how well each explains the scores of all of them there.

An effect moves the scores of the others as well, by the products H of their derivatives: at a
place where the surrogate errs much in one effect and little in another, a large size of the first
stands out most as a small size of the second. So with the joint score s of a cell, less what the
null expects, of which the variance is v by parameter, the size of effect k is that of generalised
least squares,

    s ~ N(H e_k size, C),    C = H off the diagonal, v on it:

noise correlates as the derivatives do, and what the surrogate's error adds is independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adk_ros.fleet.inference.cell_tests import CellTest
from adk_ros.fleet.inference.place_data import Visits
from adk_ros.fleet.inference.place_evidence import Cell


def evidence(
    key: str,
    cells: Sequence[Cell],
    tests: Mapping[str, Mapping[Cell, CellTest]],
    visits: Mapping[Cell, Visits],
) -> float:
    """
    Return twice the logarithm of the likelihood ratio of one size of an effect in these cells.

    `tests`: size of each parameter, in the order of the evidence, at each cell that shows it.
    """
    projected = information = 0.0
    for cell in cells:
        known = [k for k, of_key in enumerate(tests.values()) if cell in of_key]
        here = [of_key[cell] for of_key in tests.values() if cell in of_key]
        products = visits[cell].informations.sum(axis=0)
        own = np.diag(products)[known]
        signature = products[known, list(tests).index(key)]
        covariance = products[np.ix_(known, known)].copy()
        np.fill_diagonal(covariance, own**2 * np.array([test.variance for test in here]))
        weighted = np.linalg.solve(covariance, signature)
        projected += float(weighted @ (own * np.array([test.size for test in here])))
        information += float(weighted @ signature)
    return projected**2 / information if information > 0.0 else 0.0
