"""Blocks change the order of the sums and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.identification.tall import gram, triangle

SHAPES = [(1, 1), (3, 7), (255, 4), (256, 4), (257, 4), (1000, 9), (700, 300), (140000, 3)]


@pytest.mark.parametrize("shape", SHAPES)
def test_the_gram_matrix_is_the_product(shape: tuple[int, int]) -> None:
    j = np.random.default_rng(0).normal(size=shape)
    np.testing.assert_allclose(gram(j), j.T @ j, rtol=0, atol=1e-12 * shape[0])


@pytest.mark.parametrize("shape", SHAPES)
def test_the_triangle_is_triangular_and_has_the_singular_values(shape: tuple[int, int]) -> None:
    j = np.random.default_rng(1).normal(size=shape)
    r = triangle(j)
    assert r.shape == (min(shape), shape[1])
    np.testing.assert_array_equal(np.tril(r, -1), 0.0)
    np.testing.assert_allclose(
        np.linalg.svd(r, compute_uv=False), np.linalg.svd(j, compute_uv=False), rtol=1e-10
    )


def test_the_triangle_sees_what_squaring_would_lose() -> None:
    # Singular values of 1 and 1e-10: J'J holds the square of the small one below rounding.
    generator = np.random.default_rng(2)
    q, _ = np.linalg.qr(generator.normal(size=(1000, 2)))
    j = q @ np.diag([1.0, 1e-10]) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    small = np.linalg.svd(triangle(j), compute_uv=False)[1]
    assert small == pytest.approx(1e-10, rel=1e-4)
