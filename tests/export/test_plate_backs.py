"""The back of a door is painted in the areas of its front."""

from __future__ import annotations

import numpy as np
import pytest

from uniart_jax.export.plate_backs import even_backs
from uniart_jax.objects.appearance import srgb_to_linear

WHITE, DARK, GRAY = (srgb_to_linear(np.full(3, v)) for v in (0.9, 0.1, 0.5))
N = 6_000


def door(turn: float = 0.0):
    """Places of a door with a window, its front seen: points, normals, parts, shown, seen, and
    whether each is in the window's outline."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-0.4, 0.4, (2 * N, 2))
    front = np.arange(2 * N) < N
    points = np.column_stack([np.where(front, -0.02, 0.02), at])
    normals = np.tile([1.0, 0, 0], (2 * N, 1))
    normals[front] = [-1, 0, 0]
    c, s = np.cos(turn), np.sin(turn)
    about = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    window = np.abs(at).max(1) < 0.25
    shown = np.where(window[:, None], DARK, WHITE) * front[:, None]
    return points @ about.T, normals @ about.T, np.zeros(2 * N, int), shown, front, window


def blotchy(window: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Guesses of a back: dark in the middle of the window, white far from it, gray between."""
    middle = np.linalg.norm(points[:, 1:], axis=1) < 0.22
    return np.where(middle[:, None], DARK, np.where(window[:, None], GRAY, WHITE))


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_window_has_its_outline_at_the_back_too(turn):
    points, normals, parts, shown, seen, window = door(turn)
    filled = blotchy(window, door()[0])
    out = even_backs(points, normals, parts, shown, seen, filled, [0])
    back, inner = ~seen, np.abs(door()[0][:, 1:]).max(1)
    for where, color in ((inner < 0.24, DARK), (inner > 0.26, WHITE)):
        right = np.abs(out[back & where] - color).max(1) < 0.02
        assert right.mean() > 0.995
    assert (np.abs(filled[back & (inner < 0.24)] - DARK).max(1) < 0.02).mean() < 0.8
    np.testing.assert_array_equal(out[seen], filled[seen])


def test_a_back_that_is_guessed_to_be_plain_stays_so():
    points, normals, parts, shown, seen, _ = door()
    filled = np.tile(GRAY, (len(points), 1))
    out = even_backs(points, normals, parts, shown, seen, filled, [0])
    np.testing.assert_allclose(out, filled, atol=1e-6)


@pytest.mark.parametrize("case", ["plain front", "not moving", "round", "few"])
def test_other_parts_keep_what_is_guessed(case):
    points, normals, parts, shown, seen, window = door()
    filled = blotchy(window, points)
    moving = [] if case == "not moving" else [0]
    if case == "plain front":
        shown = np.tile(WHITE, (len(points), 1)) * seen[:, None]
    if case == "round":
        normals = np.random.default_rng(1).normal(size=points.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    if case == "few":
        points, normals, parts, shown, seen, filled = (
            a[:: N // 40] for a in (points, normals, parts, shown, seen, filled)
        )
    out = even_backs(points, normals, parts, shown, seen, filled, moving)
    np.testing.assert_array_equal(out, filled)
