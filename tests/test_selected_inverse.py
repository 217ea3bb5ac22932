# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Entries of sparse inverses, against numpy's dense ones."""

import numpy as np
import pytest
from scipy.sparse import csc_array

from slarm_graph.backends.selected_inverse import elimination_order, selected_inverse


def chain_with_loops(count: int, loops: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of nodes joined as along a path, and at random."""
    rng = np.random.default_rng(seed)
    i, j = rng.integers(0, count, (2, loops))
    ahead = np.arange(count - 1)
    i, j = np.concatenate([ahead, i[i != j]]), np.concatenate([ahead + 1, j[i != j]])
    return i, j


def information(count: int, i: np.ndarray, j: np.ndarray, seed: int) -> np.ndarray:
    """A positive definite matrix with entries where nodes are joined."""
    rng = np.random.default_rng(seed)
    matrix = np.diag(rng.uniform(0.01, 0.1, count))
    for a, b, weight in zip(i, j, rng.uniform(0.1, 5.0, len(i)), strict=True):
        row = np.zeros(count)
        row[a], row[b] = rng.normal(), rng.normal()
        matrix += weight * np.outer(row, row)
    return matrix


@pytest.mark.parametrize(("count", "loops"), [(1, 0), (2, 0), (30, 0), (30, 12), (60, 400)])
@pytest.mark.parametrize("in_order", [True, False])
def test_every_entry_of_the_pattern_is_that_of_the_dense_inverse(
    count: int, loops: int, in_order: bool
) -> None:
    i, j = chain_with_loops(count, loops, seed=count)
    matrix = information(count, i, j, seed=loops)
    order = np.arange(count) if in_order else elimination_order(count, i, j)
    found = selected_inverse(csc_array(matrix), order)
    assert found is not None
    expected = np.linalg.inv(matrix)
    every = np.arange(count)
    np.testing.assert_allclose(found.at(every, every), np.diag(expected), rtol=1e-9)
    np.testing.assert_allclose(found.at(i, j), expected[i, j], rtol=1e-8, atol=1e-12)
    np.testing.assert_array_equal(found.at(j, i), found.at(i, j))


def test_an_entry_outside_the_pattern_is_not_known() -> None:
    i, j = chain_with_loops(6, 0, seed=0)
    found = selected_inverse(csc_array(information(6, i, j, seed=0)), np.arange(6))
    assert found is not None
    assert np.isnan(found.at(np.array([0, 5, 1]), np.array([5, 0, 3]))).all()


def test_parts_that_nothing_joins_are_inverted_each() -> None:
    matrix = np.zeros((5, 5))
    matrix[:2, :2], matrix[2:, 2:] = [[2.0, -1.0], [-1.0, 3.0]], np.diag([4.0, 5.0, 8.0])
    order = elimination_order(5, np.array([0]), np.array([1]))
    found = selected_inverse(csc_array(matrix), order)
    assert found is not None
    every = np.arange(5)
    np.testing.assert_allclose(found.at(every, every), [0.6, 0.4, 0.25, 0.2, 0.125])
    np.testing.assert_allclose(found.at(np.array([1]), np.array([0])), [0.2])


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, 1.0])
def test_what_is_not_positive_definite_has_no_inverse(wrong: float) -> None:
    # With 1 the last two rows are the same.
    matrix = np.array([[2.0, 0.0, 0.0], [0.0, wrong, 1.0], [0.0, 1.0, 1.0]])
    assert selected_inverse(csc_array(matrix), np.arange(3)) is None


def test_the_order_of_elimination_keeps_a_star_sparse() -> None:
    """Eliminated first, its middle would join every other node with every other."""
    rays = np.arange(1, 200)
    order = elimination_order(200, np.zeros_like(rays), rays)
    assert sorted(order.tolist()) == list(range(200))
    assert order.tolist().index(0) >= 198
    matrix = information(200, np.zeros_like(rays), rays, seed=1)
    found = selected_inverse(csc_array(matrix), order)
    assert found is not None
    assert len(found.rows) == 199


def test_an_inverse_beyond_double_precision_is_none() -> None:
    """Its pivots are positive, but 1e-310 has no inverse."""
    assert selected_inverse(csc_array(np.diag([1.0, 1e-310])), np.arange(2)) is None
