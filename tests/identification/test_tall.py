"""Blocks change the order of the sums and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.identification.tall import across, inner, normal_equations, triangle

SHAPES = [(1, 1), (3, 7), (255, 4), (256, 4), (257, 4), (1000, 9), (700, 300), (140000, 3)]


@pytest.mark.parametrize("shape", SHAPES)
def test_normal_equations_are_the_products(shape: tuple[int, int]) -> None:
    generator = np.random.default_rng(0)
    j, r = generator.normal(size=shape), generator.normal(size=shape[0])
    slope, bend = normal_equations(j, r)
    allowed = 1e-12 * shape[0]
    assert inner(r, r) == pytest.approx(r @ r, rel=1e-12)
    np.testing.assert_allclose(slope, j.T @ r, rtol=0, atol=allowed)
    np.testing.assert_allclose(bend, j.T @ j, rtol=0, atol=allowed)
    np.testing.assert_allclose(across(j[:, :1], j), j[:, :1].T @ j, rtol=0, atol=allowed)


def test_an_inner_product_is_never_shared_by_threads() -> None:
    # The linear algebra library is asked for no more than it computes in one thread.
    class Counted(np.ndarray):
        longest = 0

        def __matmul__(self, other: object) -> object:
            Counted.longest = max(Counted.longest, self.size)
            return np.asarray(self) @ np.asarray(other)

    a = np.arange(30_000.0)
    assert inner(a.view(Counted), a) == pytest.approx(float(a @ a), rel=1e-14)
    assert 0 < Counted.longest <= 10_000


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
