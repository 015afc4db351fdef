"""Solvers of dx/dt = v(x, t) from noise (t = 1) to data (t = 0), in fixed or adaptive steps. They
know nothing of guidance.

With f = v(x, t) and g = v(x - h f, t - h):

    x <- x - h f               Euler   (1)
    x <- x - h (f + g) / 2     Heun    (2)
    e  = h (g - f) / 2         (2) - (1): the error of (1), for both adaptive solvers

Adaptive Euler keeps e / h below the tolerance (error per unit time), adaptive Heun e (error per
step, while the better value is taken): with either the error at t = 0 is proportional to the
tolerance (Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", II.4). g is the
next step's f in Euler, so it costs one velocity a step; Heun costs two, and one where a step is
repeated.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from uniart_jax.config import TOLERANCES

Velocity = Callable[[jax.Array, jax.Array], jax.Array]  # (x [B, ...], t scalar or [B]) -> v
Solver = Literal["euler", "heun"]
MIN_STEP = 1e-3  # a step so short is taken whatever its error
MOST = 4000  # velocities an item, after which the rest of the way is one step
SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0
LEAST_ERROR = (
    1e-4  # an error below this says no more: a straight stretch must not shorten the step after it
)
INTEGRAL, PROPORTIONAL = 0.7, 0.4  # exponents of the step controller


class Solution(NamedTuple):
    """x [B, ...] at t = 0, how many velocities each item took, and how many of its adaptive steps
    were taken with an error above the tolerance, because none shorter is tried: ``evaluations``,
    ``steps_over_tolerance`` [B] int32."""

    x: jax.Array
    evaluations: jax.Array
    steps_over_tolerance: jax.Array


def time_steps(steps: int, rescale_t: float = 1.0, end: float = 0.0) -> np.ndarray:
    """At most [steps + 1] times from 1 to 0, r t / (1 + (r - 1) t): r > 1 spends more steps near
    noise (TRELLIS). None lies between 0 and ``end``.

    Raises:
      ValueError: fewer than one step.
    """
    if steps < 1:
        raise ValueError(f"sampling needs at least 1 step, not {steps}")
    t = np.linspace(1, 0, steps + 1)
    t = rescale_t * t / (1 + (rescale_t - 1) * t)
    return t[(t >= end) | (t == 0)]


def euler(
    velocity: Velocity, x: jax.Array, steps: int, rescale_t: float = 1.0, end: float = 0.0
) -> jax.Array:
    """x at t = 0 by ``steps`` Euler steps; first order, exact where the velocity is constant along
    paths. ``end``: of ``solve``."""

    def step(x, times):
        here, after = times
        return x - (here - after) * velocity(x, here), None

    return jax.lax.scan(step, x, _intervals(time_steps(steps, rescale_t, end)))[0]


def heun(
    velocity: Velocity, x: jax.Array, steps: int, rescale_t: float = 1.0, end: float = 0.0
) -> jax.Array:
    """x at t = 0 by ``steps`` Heun steps: second order, two velocities a step; with an ``end`` the
    last one is an Euler step (``solve``)."""

    def evaluate(now, stage):  # a scan over velocities, not steps: the network is compiled once
        x, slope = now
        t, h, first, second = stage
        v = velocity(jnp.where(second, x - h * slope, x), t)
        moved = jnp.where(second, x - h * (slope + v) / 2, x - h * v)
        return (jnp.where(first, x, moved), v), None

    stages = _heun_stages(time_steps(steps, rescale_t, end), end)
    return jax.lax.scan(evaluate, (x, jnp.zeros_like(x)), stages)[0][0]


def solve(
    velocity: Velocity,
    x: jax.Array,
    solver: Solver,
    steps: int,
    rescale_t: float = 1.0,
    *,
    tolerance: float | None = None,
    valid: jax.Array | None = None,
    end: float = 0.0,
) -> Solution:
    """x at t = 0 from x [B, ...] at t = 1.

    Args:
      steps, rescale_t: the steps (``time_steps``); where they adapt, only the first one's length.
      tolerance: adaptive steps with an error of about this much, of values near 1; None = fixed
        steps. Adaptive ones are at least ``MIN_STEP`` long, whatever their error, and after
        ``MOST`` velocities one is left; ``Solution.steps_over_tolerance`` counts those.
      valid: mask, broadcastable to x; what is outside does not count as error.
      end: at times below it the velocity is not asked for: the last stretch is one Euler step from
        there or, with fixed steps, from the last of their times that is not below it; those between
        are left out. For networks that predict x_0, whose velocity is a difference over t.

    Raises:
      ValueError: fewer than one step, or a tolerance outside ``config.TOLERANCES``.
    """
    times = time_steps(steps, rescale_t, end)
    if tolerance is not None:
        first = min(float(times[0] - times[1]), 1.0 - end)
        return _adaptive(velocity, x, solver, first, tolerance, valid, end)
    if solver == "heun":
        evaluations = len(_heun_stages(times, end)[0])
        x = heun(velocity, x, steps, rescale_t, end)
    else:
        evaluations, x = len(times) - 1, euler(velocity, x, steps, rescale_t, end)
    each = jnp.full(x.shape[0], evaluations, jnp.int32)
    return Solution(x, each, jnp.zeros_like(each))


class _Progress(NamedTuple):
    """Where each item stands: x at time t, the velocity there if ``known``, the step it tries next,
    the error of the last one, whether the last try was refused, velocities so far, steps over
    the tolerance."""

    x: jax.Array
    t: jax.Array
    slope: jax.Array
    known: jax.Array
    step: jax.Array
    error: jax.Array
    refused: jax.Array
    evaluations: jax.Array
    steps_over_tolerance: jax.Array


def _adaptive(
    velocity: Velocity,
    x: jax.Array,
    solver: Solver,
    first: float,
    tolerance: float,
    valid: jax.Array | None,
    end: float,
) -> Solution:
    """Each item in steps of its own. A round of the loop is one call of the velocity, for all
    items, each where it is: at the start of its step or at its trial end; so the network is
    compiled once, no item waits for another's second stage, and one that is done stays as it is."""
    least, most = TOLERANCES
    if not least <= tolerance <= most:
        raise ValueError(f"tolerance must be in {least:g}..{most:g}, got {tolerance:g}")
    items, order = x.shape[0], 2 if solver == "heun" else 1
    inside = jnp.broadcast_to(True if valid is None else valid, x.shape)

    def over(a: jax.Array) -> jax.Array:
        return a.reshape(-1, *[1] * (x.ndim - 1))

    def norm(error: jax.Array, before: jax.Array, after: jax.Array) -> jax.Array:
        """[B] root mean square of the error in units of what is allowed: 1 is just right."""
        allowed = tolerance * (1 + jnp.maximum(jnp.abs(before), jnp.abs(after)))
        squares = jnp.where(inside, jnp.square(error / allowed), 0)
        axes = tuple(range(1, x.ndim))
        return jnp.sqrt(squares.sum(axes) / jnp.maximum(inside.sum(axes), 1))

    def body(now: _Progress) -> _Progress:
        running = now.t > 0
        left = now.t - end
        enough = now.evaluations >= MOST  # no controller is trusted to come to an end by itself
        last = (now.step >= left * 0.9) | enough  # no sliver is left for another step
        h = jnp.where(last, left, now.step)
        after = jnp.where(last, end, now.t - h)
        trial = now.x - over(h) * now.slope
        v = velocity(jnp.where(over(now.known), trial, now.x), jnp.where(now.known, after, now.t))

        change = (v - now.slope) / 2
        if solver == "heun":
            reached, error = trial - over(h) * change, over(h) * change
        else:
            reached, error = trial, change
        size = norm(error, now.x, reached)
        # ``last`` may stretch a step of the least length; a rejection would only bring the same
        # again
        finite, shortest = jnp.isfinite(size), (h <= MIN_STEP) | (now.step <= MIN_STEP) | enough
        tried = running & now.known
        accepted = tried & ((finite & (size <= 1)) | shortest)
        scaled = jnp.maximum(size, LEAST_ERROR)
        grown = SAFETY * scaled ** (-INTEGRAL / order) * now.error ** (PROPORTIONAL / order)
        shrunk = SAFETY * scaled ** (-1 / order)
        # what was too long just now is not made longer by one step that went well
        grown = jnp.clip(grown, SHRINK, jnp.where(now.refused, 1.0, GROW))
        factor = jnp.where(size <= 1, grown, jnp.clip(shrunk, SHRINK, SAFETY))
        step = jnp.maximum(h * jnp.where(finite, factor, SHRINK), MIN_STEP)

        x = jnp.where(over(accepted), reached, now.x)
        t = jnp.where(accepted, after, now.t)
        t = jnp.where(tried & shortest & ~finite, 0.0, t)  # no shorter step will mend that
        starts = running & ~now.known
        fresh = starts | (accepted & (solver == "euler"))  # v was asked for at (x, t)
        known = jnp.where(accepted, solver == "euler", now.known | starts)
        slope = jnp.where(over(fresh), v, now.slope)
        leap = known & (t <= end) & (t > 0)
        x = jnp.where(over(leap), x - over(t) * slope, x)
        return _Progress(
            x,
            jnp.where(leap, 0.0, t),
            slope,
            known,
            jnp.where(tried, step, now.step),
            jnp.where(accepted & finite, scaled, now.error),
            jnp.where(tried, ~accepted, now.refused),
            now.evaluations + running,
            now.steps_over_tolerance + (tried & shortest & ~(finite & (size <= 1))),
        )

    start = _Progress(
        x,
        jnp.ones(items),
        jnp.zeros_like(x),
        jnp.zeros(items, bool),
        jnp.full(items, first),
        jnp.ones(items),
        jnp.zeros(items, bool),
        jnp.zeros(items, jnp.int32),
        jnp.zeros(items, jnp.int32),
    )
    done = jax.lax.while_loop(lambda now: (now.t > 0).any(), body, start)
    return Solution(done.x, done.evaluations, done.steps_over_tolerance)


def _heun_stages(
    times: np.ndarray, end: float
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """[n] time, step, whether it is the first or the second of a Heun step's two velocities; one
    that is neither makes an Euler step."""
    stages = []
    for here, after in itertools.pairwise(times):
        h, whole = here - after, after >= end
        stages.append((here, h, whole, False))
        if whole:
            stages.append((after, h, False, True))
    t, h, first, second = zip(*stages, strict=True)
    return jnp.array(t, jnp.float32), jnp.array(h, jnp.float32), jnp.array(first), jnp.array(second)


def _intervals(times: np.ndarray) -> tuple[jax.Array, jax.Array]:
    t = jnp.asarray(times, jnp.float32)
    return t[:-1], t[1:]
