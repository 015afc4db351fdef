from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uniart_jax.voxels.overlap import cells_in_ranges, clipped_areas, touched_cells

RESOLUTION = 4
# Eighths of a cell, so that touching at exactly one point is common and exact.
corner = st.tuples(*[st.integers(0, 8 * RESOLUTION).map(lambda n: n / 8)] * 3)


def clip(polygon, cell):
    """Sutherland-Hodgman in exact arithmetic against the closed cell: the corners left."""
    polygon = [tuple(Fraction(c) for c in p) for p in polygon]
    for axis in range(3):
        for sign, limit in ((1, cell[axis]), (-1, -cell[axis] - 1)):
            left = []
            for i, p in enumerate(polygon):
                q = polygon[(i + 1) % len(polygon)]
                a, b = sign * p[axis] - limit, sign * q[axis] - limit
                if (a < 0) != (b < 0):
                    left.append(tuple(x + a / (a - b) * (y - x) for x, y in zip(p, q, strict=True)))
                if b >= 0:
                    left.append(q)
            polygon = left
            if not polygon:
                return []
    return polygon


def area(polygon):
    p = np.array(polygon, dtype=float)
    return np.linalg.norm(np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(0)) / 2 if len(p) > 2 else 0.0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=3))
def test_touched_cells_are_those_of_an_exact_clip(triangles):
    found = touched_cells(np.array(triangles), RESOLUTION)
    found = {(int(f), *map(int, c)) for f, c in zip(*found, strict=True)}
    expected = {
        (f, *cell)
        for f, triangle in enumerate(triangles)
        for cell in np.ndindex(*(RESOLUTION,) * 3)
        if clip(triangle, cell)
    }
    assert found == expected


@settings(max_examples=40, deadline=None)
@given(st.tuples(corner, corner, corner))
def test_clipped_areas_are_those_of_an_exact_clip(triangle):
    _, cells = touched_cells(np.array([triangle]), RESOLUTION)
    areas = clipped_areas(np.repeat(np.array([triangle]), len(cells), 0), cells)
    expected = [area(clip(triangle, c)) for c in cells.tolist()]
    np.testing.assert_allclose(areas, expected, atol=1e-9)


def test_clipped_areas_of_a_slanted_triangle_add_up():
    triangle = np.array([[0.31, 0.22, 0.13], [3.7, 1.1, 2.9], [1.2, 3.6, 0.7]])
    _, cells = touched_cells(triangle[None], RESOLUTION)
    areas = clipped_areas(np.repeat(triangle[None], len(cells), 0), cells)
    assert areas.sum() == pytest.approx(area(triangle), rel=1e-12)


def test_a_triangle_outside_the_grid_is_clamped_to_its_border():
    triangle = np.array([[[4.0, 1.5, 1.5], [4.0, 2.5, 1.5], [4.0, 1.5, 2.5]]])
    _, cells = touched_cells(triangle, RESOLUTION)
    assert len(cells) and (cells[:, 0] == 3).all()


@pytest.mark.parametrize("limit", [1, 7, 10_000])
def test_ranges_are_listed_in_full_whatever_the_chunk(limit):
    rng = np.random.default_rng(0)
    low = rng.integers(0, 5, (20, 3))
    high = low + rng.integers(-1, 4, (20, 3))  # some are empty
    chunks = list(cells_in_ranges(low, high, limit))
    found = [
        (int(i), *map(int, c)) for items, cells in chunks for i, c in zip(items, cells, strict=True)
    ]
    expected = [
        (i, *map(int, low[i] + np.array(step)))
        for i in range(20)
        for step in np.ndindex(*np.maximum(high[i] - low[i] + 1, 0))
    ]
    assert found == expected
    largest = np.maximum(high - low + 1, 0).prod(1).max()
    assert max(len(items) for items, _ in chunks) <= max(limit, largest)
