"""Backgrounds that pictures of objects are put in front of."""

import itertools

import numpy as np

from uniart_jax.data.backdrops import backdrop, leaves, training_backdrop


def test_backgrounds_differ():
    pictures = [backdrop(np.random.default_rng(i), 64) for i in range(12)]
    assert all(p.shape == (64, 64, 3) and p.dtype == np.float32 for p in pictures)
    assert all(p.min() >= 0 and p.max() <= 1 for p in pictures)
    pairs = itertools.combinations(pictures, 2)
    assert min(np.abs(a - b).mean() for a, b in pairs) > 0.01


def test_dead_leaves_have_edges_at_every_scale():
    """Halving a picture leaves about as much contrast between neighbours: in noise it falls by
    more, in one gradient it doubles."""
    pictures = [leaves(np.random.default_rng(i), 128) for i in range(16)]
    assert all(p.shape == (128, 128, 3) and p.dtype == np.float32 for p in pictures)
    assert all(p.min() >= 0 and p.max() <= 1 for p in pictures)

    def contrast(picture):
        return np.abs(np.diff(picture, axis=0)).mean()

    half = [p.reshape(64, 2, 64, 2, 3).mean((1, 3)) for p in pictures]
    ratios = [contrast(h) / contrast(p) for h, p in zip(half, pictures, strict=True)]
    assert 0.8 < np.median(ratios) < 1.6


def test_trainings_see_both_kinds_of_background(monkeypatch):
    monkeypatch.setattr("uniart_jax.data.backdrops.leaves", lambda rng, size: "leaves")
    monkeypatch.setattr("uniart_jax.data.backdrops.backdrop", lambda rng, size: "backdrop")
    drawn = [str(training_backdrop(np.random.default_rng(i), 48)) for i in range(200)]
    assert 60 <= drawn.count("leaves") <= 100
    assert drawn.count("backdrop") == 200 - drawn.count("leaves")
