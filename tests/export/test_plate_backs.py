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


def joined(*scenes):
    """Scenes one after the other, each a part: the arguments of ``even_backs`` but the last."""
    rows = [(*scene[:2], np.full(len(scene[0]), k), *scene[3:]) for k, scene in enumerate(scenes)]
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def test_each_part_goes_by_its_own_front_and_what_is_far_behind_stays():
    points, normals, parts, shown, seen, window = door()
    filled = blotchy(window, points)
    plain = np.tile(WHITE, (len(points), 1)) * seen[:, None]
    other = (points + [0.0, 0.1, 0], normals, parts, plain, seen, np.tile(GRAY, (len(points), 1)))
    rear = np.where(seen[:, None], points, points + [0.4, 0, 0])
    tank = (rear, normals, parts, shown, seen, filled)
    scene = joined((points, normals, parts, shown, seen, filled), other, tank)
    out = even_backs(*scene, [0, 1, 2])
    n = len(points)
    alone = even_backs(points, normals, parts, shown, seen, filled, [0])
    np.testing.assert_array_equal(out[:n], alone)
    np.testing.assert_array_equal(out[n:], scene[-1][n:])


def test_edges_and_backs_without_a_front_keep_their_colours():
    points, normals, parts, shown, seen, window = door()
    filled = blotchy(window, points)
    edge = ~seen & (np.abs(points[:, 1]) > 0.36)
    normals[edge] = [0, 1, 0]
    lower = seen & (points[:, 2] < -0.1)  # of this half the picture shows nothing
    seen, kept = seen & ~lower, ~seen & (points[:, 2] < -0.14)
    filled[edge] = GRAY
    out = even_backs(points, normals, parts, shown, seen, filled, [0])
    np.testing.assert_array_equal(out[edge | kept | lower], filled[edge | kept | lower])
    upper = ~seen & ~edge & (points[:, 2] > 0) & window
    assert (np.abs(filled[upper] - out[upper]).max(1) > 0.02).any()


def test_guesses_beside_an_edge_do_not_count():
    """They bleed over it: of a narrow frame, more than half are those of the window."""
    points, normals, parts, shown, seen, _ = door()
    inner = np.abs(points[:, 1:]).max(1)
    shown = np.where((inner < 0.37)[:, None], DARK, WHITE) * seen[:, None]
    filled = np.where((inner < 0.386)[:, None], DARK, WHITE)
    out = even_backs(points, normals, parts, shown, seen, filled, [0])
    frame = ~seen & (inner > 0.376) & (inner < 0.39)
    assert (np.abs(out[frame] - WHITE).max(1) < 0.02).mean() > 0.9
    assert (np.abs(filled[frame] - WHITE).max(1) < 0.02).mean() < 0.5


def test_specks_and_single_places_of_a_front_make_no_areas():
    points, normals, parts, shown, seen, window = door()
    rng = np.random.default_rng(2)
    red = srgb_to_linear(np.array([0.9, 0.1, 0.1]))
    shown[seen & (np.linalg.norm(points[:, 1:] - 0.33, axis=1) < 0.04)] = red
    wrong = seen & (rng.random(len(points)) < 0.08)
    shown[wrong] = srgb_to_linear(rng.random((wrong.sum(), 3)))
    filled = blotchy(window, points)
    out = even_backs(points, normals, parts, shown, seen, filled, [0])
    inner = np.abs(points[:, 1:]).max(1)
    for where, color in ((inner < 0.23, DARK), (inner > 0.27, WHITE)):
        assert (np.abs(out[~seen & where] - color).max(1) < 0.03).mean() > 0.99


@pytest.mark.parametrize("case", ["plain front", "not moving", "round", "two ways", "few"])
def test_other_parts_keep_what_is_guessed(case):
    points, normals, parts, shown, seen, window = door()
    filled = blotchy(window, points)
    moving = [] if case == "not moving" else [0]
    if case == "plain front":
        shown = np.tile(WHITE, (len(points), 1)) * seen[:, None]
    if case == "round":
        normals = np.random.default_rng(1).normal(size=points.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    if case == "two ways":  # two thirds of a corner's places look to the side
        normals[seen & (np.arange(len(points)) % 3 > 0)] = [0, 0.6, 0.8]
    if case == "few":
        points, normals, parts, shown, seen, filled = (
            a[:: N // 40] for a in (points, normals, parts, shown, seen, filled)
        )
    out = even_backs(points, normals, parts, shown, seen, filled, moving)
    np.testing.assert_array_equal(out, filled)
