import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.flow.guidance import guide
from uniart_jax.flow.rectified import (
    flow_loss,
    interpolate,
    predicted_sample,
    sample_times,
    velocity_target,
)
from uniart_jax.flow.solvers import euler, heun, time_steps

loss = jax.jit(flow_loss)


def normal(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.0, 1e-5, 0.1])
def test_target_is_the_paths_derivative_and_leads_back(sigma):
    x0, noise, t = normal(3, 4, 2), normal(3, 4, 2, seed=1), np.float32([0.1, 0.5, 0.9])

    @jax.jit
    def found(x0, noise, t):
        x, slope = jax.jvp(lambda t: interpolate(x0, noise, t, sigma), (t,), (jnp.ones(3),))
        v = velocity_target(x0, noise, sigma)
        last = interpolate(x0, noise, jnp.ones(3))
        return slope, v, predicted_sample(x, v, t, sigma), last

    slope, v, back, last = found(x0, noise, t)
    np.testing.assert_allclose(slope, v, atol=1e-6)
    np.testing.assert_allclose(back, x0, atol=1e-5)
    np.testing.assert_allclose(last, noise, atol=1e-6)


def test_loss_is_a_mean_per_object_over_valid_voxels():
    x0, noise = normal(3, 6, 2), normal(3, 6, 2, seed=1)
    v = velocity_target(x0, noise) + np.float32([1, 2, 5])[:, None, None]
    mask = np.arange(6) < np.array([6, 2, 0])[:, None]
    np.testing.assert_allclose(loss(v, x0, noise, mask), [1, 4, 0], rtol=1e-5)
    np.testing.assert_allclose(loss(v, x0, noise), [1, 4, 25], rtol=1e-5)
    np.testing.assert_allclose(loss(v, x0, noise, np.float32(0.1) * mask), [1, 4, 0], rtol=1e-5)
    dirty = [np.where(mask[..., None], a, np.float32(np.nan)) for a in (v, x0, noise)]
    gradient = jax.jit(jax.grad(lambda v: flow_loss(v, *dirty[1:], mask).sum()))(dirty[0])
    assert np.isfinite(gradient).all() and not np.asarray(gradient)[~mask].any()


def test_times_are_logit_normal_with_a_share_of_noise():
    draw = jax.jit(sample_times, static_argnums=1, static_argnames="noise_share")
    t = np.asarray(draw(jax.random.key(0), (20_000,), mean=1.0, std=1.0))
    assert abs(np.median(t) - 1 / (1 + np.exp(-1))) < 0.01 and (t > 0).all() and (t < 1).all()
    late = np.asarray(draw(jax.random.key(0), (20_000,), mean=-20.0, noise_share=0.25))
    assert abs((late > 0.9).mean() - 0.25) < 0.02


def test_time_steps_are_trelliss():
    np.testing.assert_allclose(time_steps(4), [1, 0.75, 0.5, 0.25, 0])
    expected = [3 * t / (1 + 2 * t) for t in np.linspace(1, 0, 13)]
    np.testing.assert_allclose(time_steps(12, 3.0), expected)
    with pytest.raises(ValueError, match="at least 1"):
        time_steps(0)


def test_euler_is_exact_on_straight_paths():
    x0, noise = normal(3, 4), normal(3, 4, seed=1)
    for steps in (1, 7):
        run = jax.jit(euler, static_argnums=(0, 2), static_argnames="rescale_t")
        out = run(lambda x, t: noise - x0, noise, steps, rescale_t=3.0)
        np.testing.assert_allclose(out, x0, atol=1e-6)


def test_orders_of_convergence():
    exact = np.exp(-1.0)  # dx/dt = x from t = 1 to 0

    def error(solver, steps):
        run = jax.jit(lambda x: solver(lambda x, t: x, x, steps))
        return abs(run(np.ones(1, np.float32)).item() - exact)

    assert 1.8 < error(euler, 10) / error(euler, 20) < 2.2
    assert 3.5 < error(heun, 10) / error(heun, 20) < 4.5


def test_guidance_extrapolates_within_its_interval():
    calls = []

    def velocity(x, t, condition):
        calls.append(x.shape[0])
        assert t.shape == (x.shape[0],)
        return x * 0 + condition

    condition, negative = np.float32([[0], [1]]), np.full((2, 1), 10, np.float32)
    x = np.zeros((2, 3), np.float32)
    guided = jax.jit(guide(velocity, condition, negative, 2.0, (0.5, 1.0)))
    inside, outside = (np.asarray(guided(x, np.float32(t))) for t in (0.5, 0.4))
    np.testing.assert_allclose(inside[:, 0], [0 + 2 * (0 - 10), 1 + 2 * (1 - 10)])
    np.testing.assert_allclose(outside[:, 0], [0, 1])
    calls.clear()
    none = jax.jit(guide(velocity, condition, negative, 0.0))
    np.testing.assert_allclose(np.asarray(none(x, np.float32(0.7)))[:, 0], [0, 1])
    assert calls == [2]


@pytest.mark.parametrize(
    ("t", "guided"), [(0.1, 0), (0.19, 0), (0.2, 1), (0.5, 1), (0.8, 1), (0.81, 0), (1.0, 0)]
)
def test_outside_its_interval_the_condition_alone_is_asked_for(t, guided):
    """Both ends belong to the interval; outside it a velocity costs one network call an item."""
    items = []

    def velocity(x, t, condition):
        items.append(len(x))
        return 0 * x + condition

    condition, negative = np.ones((2, 1), np.float32), np.full((2, 1), 4, np.float32)
    velocity_at = guide(velocity, condition, negative, 2.0, (0.2, 0.8))
    with jax.disable_jit():  # so that only the branch that is taken is run
        v = velocity_at(np.zeros((2, 3), np.float32), np.float32(t))
    np.testing.assert_allclose(v, 1 + guided * 2 * (1 - 4))
    assert items == [4 if guided else 2]


def test_voxels_count_as_they_weigh():
    v, zero = np.float32([[[1], [3]]]), np.zeros((1, 2, 1), np.float32)
    weights = np.float32([[0.75, 0.25]])
    assert loss(v, zero, zero, weights).item() == pytest.approx(0.75 * 1 + 0.25 * 9)


def test_loss_under_a_metric():
    rng = np.random.default_rng(5)
    v, x0, noise = (np.float32(rng.normal(size=(2, 7, 3))) for _ in range(3))
    weights = np.float32(rng.random((2, 7)) * (rng.random((2, 7)) > 0.3))
    plain = loss(v, x0, noise, weights)
    alike = loss(v, x0, noise, weights, metric=np.eye(3, dtype=np.float32) / 3)
    np.testing.assert_allclose(alike, plain, rtol=1e-5)
    readout = np.float32([[1], [-2], [0.5]])
    error = ((v - noise + x0) @ readout)[..., 0] ** 2
    expected = (error * weights).sum(1) / weights.sum(1)
    found = loss(v, x0, noise, weights, metric=readout @ readout.T)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
