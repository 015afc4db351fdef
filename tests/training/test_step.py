"""State, optimizer and one step: schedules, what decays, what moves, the key, the average, values
that are not finite."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.config import MeshConfig, StageConfig
from uniart_jax.training.sharding import make_mesh
from uniart_jax.training.state import create_state, make_optimizer, make_schedule
from uniart_jax.training.step import make_train_step


def init(key):
    return {"kernel": jax.random.normal(key, (3, 2)), "bias": jnp.zeros(2)}


def quadratic(params, batch, key):
    noise = jax.random.normal(key, (2,))
    loss = jnp.mean((batch @ params["kernel"] + params["bias"]) ** 2)
    return loss, {"noise": noise[0]}


def fresh(stage, loss_fn=quadratic, **options):
    optimizer = make_optimizer(stage)
    state = create_state(init, optimizer, jax.random.key(0), make_mesh(MeshConfig()))
    return state, make_train_step(loss_fn, optimizer, stage.ema_decay, **options)


def first_update(optimizer, gradient, params):
    """Updates and state of the optimizer's first step."""
    run = jax.jit(
        lambda gradient, params: optimizer.update(gradient, optimizer.init(params), params)
    )
    return run(gradient, params)


def test_schedules():
    stage = StageConfig(steps=100, warmup_steps=10, learning_rate=2.0)
    constant = make_schedule(stage)
    assert [float(constant(i)) for i in (0, 10, 99)] == pytest.approx([0.2, 2.0, 2.0])
    cosine = make_schedule(StageConfig(100, warmup_steps=10, learning_rate=2.0, schedule="cosine"))
    assert [float(cosine(i)) for i in (0, 10, 55, 100)] == pytest.approx([0.2, 2.0, 1.0, 0.0])
    short = make_schedule(StageConfig(steps=1, warmup_steps=1000, learning_rate=2.0))
    assert float(short(0)) == pytest.approx(2.0)


def test_a_frozen_position_table_stays():
    optimizer = make_optimizer(StageConfig(learning_rate=1.0, warmup_steps=0, weight_decay=0.5))
    ones = np.ones((2, 3), np.float32)
    params = {"pos_emb": ones, "layer": {"kernel": ones}}
    updates, _ = first_update(optimizer, jax.tree.map(np.zeros_like, params), params)
    assert not np.asarray(updates["pos_emb"]).any() and np.asarray(updates["layer"]["kernel"]).all()


def test_only_kernels_decay():
    optimizer = make_optimizer(StageConfig(learning_rate=1.0, warmup_steps=0, weight_decay=0.5))
    params = {"kernel": np.ones((2, 2), np.float32), "bias": np.ones(2, np.float32)}
    updates = first_update(optimizer, jax.tree.map(np.zeros_like, params), params)[0]
    updates = jax.device_get(updates)
    assert float(updates["kernel"][0, 0]) == pytest.approx(-0.5)
    assert float(updates["bias"][0]) == 0


def test_gradients_are_clipped_by_their_global_norm():
    def moment(clip, scale):
        optimizer = make_optimizer(StageConfig(gradient_clip=clip, betas=(0.0, 0.999)))
        params = {"kernel": np.ones((2, 2), np.float32)}
        gradient = {"kernel": np.full((2, 2), scale, np.float32)}
        _, state = first_update(optimizer, gradient, params)
        (mu,) = [leaf for leaf in jax.tree.leaves(state) if leaf.shape == (2, 2)][:1]
        return float(np.linalg.norm(mu))

    assert moment(1.0, 100.0) == pytest.approx(1.0)
    assert moment(1.0, 0.1) == pytest.approx(0.2)
    assert moment(0.0, 100.0) == pytest.approx(200.0)


def test_a_step_moves_averages_and_reports():
    state, step = fresh(StageConfig(learning_rate=0.1, warmup_steps=0, ema_decay=0.999))
    before = jax.tree.map(np.array, state)
    batch = np.ones((4, 3), np.float32)
    after, metrics = step(state, batch, jax.random.key(5))
    assert int(after.step) == 1
    decay = 2 / 11  # of the first step, min(.999, (1 + 1) / (10 + 1))
    for name in ("kernel", "bias"):
        expected = decay * before.ema[name] + (1 - decay) * np.asarray(after.params[name])
        np.testing.assert_allclose(after.ema[name], expected, rtol=1e-6)
        assert np.abs(np.asarray(after.params[name]) - before.params[name]).max() > 0.05
    gradient_of = jax.jit(jax.grad(lambda p: quadratic(p, batch, jax.random.key(0))[0]))
    grads = jax.device_get(gradient_of(before.params))
    norm = np.sqrt(sum(float((g**2).sum()) for g in jax.tree.leaves(grads)))
    assert float(metrics["grad_norm"]) == pytest.approx(norm, rel=1e-5)
    assert set(metrics) == {"loss", "grad_norm", "finite", "noise"}
    assert bool(metrics["finite"])


@pytest.mark.parametrize("start", [0, 17_988])
def test_the_average_follows_its_decay_over_several_steps(start):
    """First (1 + n) / (10 + n) of step n, from step 17,990 on the config's .9995."""
    state, step = fresh(StageConfig(learning_rate=0.1, warmup_steps=0))
    state = state._replace(step=jax.device_put(np.full_like(state.step, start)))
    expected, decays = np.asarray(state.ema["kernel"], np.float64), []
    for n in range(start + 1, start + 5):
        state, _ = step(state, np.ones((4, 3), np.float32), jax.random.key(5))
        decays.append(min(0.9995, (1 + n) / (10 + n)))
        expected = decays[-1] * expected + (1 - decays[-1]) * np.asarray(state.params["kernel"])
    assert (decays[-1] == 0.9995) == (start > 0) and decays[0] < 0.9995
    away = np.abs(expected - np.asarray(state.params["kernel"])).max()
    np.testing.assert_allclose(state.ema["kernel"], expected, atol=1e-4 * away + 1e-6)


def test_the_key_follows_the_step_and_nothing_else():
    key = jax.random.key(5)
    state, step = fresh(StageConfig())
    noises = []
    for _ in range(3):
        state, metrics = step(state, np.ones((4, 3), np.float32), key)
        noises.append(float(metrics["noise"]))
    draw = jax.jit(lambda i: jax.random.normal(jax.random.fold_in(key, i), (2,))[0])
    assert noises == [float(draw(i)) for i in range(3)]


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_leave_the_state_as_it_was(value, skip):
    state, step = fresh(StageConfig(), skip=skip)
    state, _ = step(state, np.ones((4, 3), np.float32), jax.random.key(0))
    before = jax.tree.map(np.array, state)
    before = before._replace(step=before.step + skip)  # the next one draws other noise
    after, metrics = step(state, np.full((4, 3), value, np.float32), jax.random.key(0))
    assert not bool(metrics["finite"])
    jax.tree.map(np.testing.assert_array_equal, before, jax.tree.map(np.asarray, after))


def test_what_is_given_is_read_by_every_part_of_every_step_and_stays():
    def through(params, batch, key, frozen):
        return quadratic(params, batch @ frozen["mix"], key)

    rng = np.random.default_rng(5)
    frozen = {"mix": jax.device_put(rng.normal(size=(4, 3)).astype(np.float32))}
    batch, mixed = rng.normal(size=(4, 4)).astype(np.float32), np.asarray(frozen["mix"])
    state, plain = fresh(StageConfig(warmup_steps=0))
    for _ in range(2):
        state, _ = plain(state, batch @ mixed, jax.random.key(2))
    for accumulate, batches in ((1, batch), (2, (batch[:2], batch[2:]))):
        other, step = fresh(
            StageConfig(warmup_steps=0), through, accumulate=accumulate, frozen_params=frozen
        )
        for _ in range(2):
            other, _ = step(other, batches, jax.random.key(2))
        for a, b in zip(jax.tree.leaves(state.params), jax.tree.leaves(other.params), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6)
        assert not frozen["mix"].is_deleted()


def test_the_step_compiles_once():
    traces = []

    def loss_fn(params, batch, key):
        traces.append(1)
        return quadratic(params, batch, key)

    state, step = fresh(StageConfig(), loss_fn)
    for _ in range(3):
        state, _ = step(state, np.ones((4, 3), np.float32), jax.random.key(0))
    assert len(traces) == 1
