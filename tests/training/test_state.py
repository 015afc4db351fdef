"""Adaptive clipping and frozen parameters: what the optimizer remembers, and what it leaves
alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.config import StageConfig
from uniart_jax.models.network import flat_names
from uniart_jax.training.checkpoints import Checkpoints
from uniart_jax.training.state import (
    RecentNorms,
    clip_by_recent_norms,
    create_state,
    frozen_mask,
    make_optimizer,
)
from uniart_jax.training.step import make_train_step

WIDTH = 400  # so many numbers that an average of equals shows its rounding


class Peer:
    """TRELLIS's AdaptiveGradClipper in numpy: the norm is recorded before clipping, the threshold
    follows once the buffer is full."""

    def __init__(self, most, percentile, window):
        self.most, self.percentile, self.window = most, percentile, window
        self.norms, self.threshold = [], most

    def clip(self, gradient):
        norm = float(np.sqrt((gradient**2).sum()))
        used = self.threshold
        self.norms = [*self.norms, norm][-self.window :]
        if len(self.norms) == self.window:
            self.threshold = min(self.most, float(np.percentile(self.norms, self.percentile)))
        return gradient * min(1.0, used / norm), used


@pytest.mark.parametrize("most", [1.0, 0.0])
def test_clipping_follows_the_recent_norms_as_trellis(most):
    ours = clip_by_recent_norms(most, 80.0, 7)
    peer = Peer(most or np.inf, 80.0, 7)
    rng, update = np.random.default_rng(0), jax.jit(ours.update)
    state = ours.init(None)
    adapted = 0
    for _ in range(30):  # the ring goes round four times
        gradient = rng.normal(size=5).astype(np.float32) * np.float32(
            rng.choice([0.1, 0.2, 0.3, 5.0], p=[0.3, 0.3, 0.3, 0.1])
        )
        expected, threshold = peer.clip(gradient)
        found, state = update({"kernel": gradient}, state)
        np.testing.assert_allclose(found["kernel"], expected, rtol=1e-5)
        if np.isfinite(threshold):
            assert float(state.threshold) == pytest.approx(threshold, rel=1e-5)
        adapted += threshold < (most or np.inf)
    assert adapted > 10
    assert 7 <= int(state.count) < 14


@pytest.mark.parametrize(("percentile", "window"), [(101, 10), (95, 0)])
def test_clipping_refuses_what_makes_no_sense(percentile, window):
    with pytest.raises(ValueError, match="give a percentile in"):
        make_optimizer(StageConfig(clip_percentile=percentile, clip_window=window))


def init(key):
    first, second = jax.random.split(key)
    return {
        "trunk": {"kernel": jax.random.normal(first, (3, WIDTH)), "bias": -jnp.zeros(WIDTH)},
        "head": {0: {"kernel": jax.random.normal(second, (WIDTH, 2)), "bias": jnp.zeros(2)}},
    }


def loss_fn(params, batch, key):
    head = params["head"][0]
    y = jnp.tanh(batch @ params["trunk"]["kernel"] + params["trunk"]["bias"])
    return jnp.mean((y @ head["kernel"] + head["bias"] - 1) ** 2), {}


def fresh(**settings):
    stage = StageConfig(learning_rate=0.1, warmup_steps=0, **settings)
    optimizer = make_optimizer(stage)
    state = create_state(init, optimizer, jax.random.key(0))
    return state, make_train_step(loss_fn, optimizer, stage.ema_decay, freeze=stage.freeze)


@pytest.mark.parametrize("muon", [0.0, 2.0])
def test_momentum_does_not_move_what_a_batch_does_not_read(muon):
    """Muon's steps are as large whatever the gradient is, also of what is not in the loss."""

    def trunk_alone(params, batch, key):
        if len(batch) == 8:
            return loss_fn(params, batch, key)
        return jnp.mean(jnp.tanh(batch @ params["trunk"]["kernel"]) ** 2), {}

    stage = StageConfig(learning_rate=0.1, warmup_steps=0, muon=muon)
    optimizer = make_optimizer(stage)
    state = create_state(init, optimizer, jax.random.key(0))
    step = make_train_step(
        trunk_alone, optimizer, 0.9, idle=lambda batch: () if len(batch) == 8 else ("head",)
    )
    batch = np.random.default_rng(0).normal(size=(8, 3)).astype(np.float32)
    moved = []
    for some in (batch, batch[:4], batch[:4], batch):
        before = {n: np.array(leaf) for n, leaf in flat_names(state).items()}
        state, _ = step(state, some, jax.random.key(1))
        after = flat_names(state)
        moved.append({n for n in before if (np.asarray(after[n]) != before[n]).any()})
    for names, whole in zip(moved, (True, False, False, True), strict=True):
        assert "params.trunk.kernel" in names
        for name in ("params.head.0.kernel", "params.head.0.bias", "ema.head.0.kernel"):
            assert (name in names) == whole, name


def test_frozen_parameters_stay_bit_for_bit_and_have_no_moments():
    state, step = fresh(freeze=("trunk", "head.0.bias"))
    # as after steps of before: an average that is apart from its parameters would move towards them
    apart = jax.jit(lambda tree: jax.tree.map(lambda p: p * 1.3 + 0.1, tree))
    state = state._replace(ema=apart(state.ema))
    before = {name: np.asarray(leaf).tobytes() for name, leaf in flat_names(state).items()}
    moments = [n for n in before if n.startswith("opt_state") and n.endswith(("kernel", "bias"))]
    assert {n.partition("head")[1] for n in moments} == {"head"} and len(moments) == 2
    batch = np.random.default_rng(0).normal(size=(8, 3)).astype(np.float32)
    for _ in range(3):
        state, metrics = step(state, batch, jax.random.key(1))
    after = {name: np.asarray(leaf).tobytes() for name, leaf in flat_names(state).items()}
    kept = ["trunk.kernel", "trunk.bias", "head.0.bias"]
    for part in ("params", "ema"):
        same = {
            n.removeprefix(f"{part}.")
            for n in after
            if n.startswith(part) and after[n] == before[n]
        }
        assert same == set(kept), part
    # the norm is that of what is trained
    grads = jax.jit(lambda key: jax.grad(lambda p: loss_fn(p, batch, None)[0])(init(key)))(
        jax.random.key(0)
    )
    state, step = fresh(freeze=("trunk", "head.0.bias"))
    _, metrics = step(state, batch, jax.random.key(1))
    norm = np.linalg.norm(grads["head"][0]["kernel"])
    assert float(metrics["grad_norm"]) == pytest.approx(float(norm), rel=1e-5)


def test_nothing_is_differentiated_by_frozen_parameters():
    """The gradient of the first layer costs two products of its size; a frozen one none."""

    def products(**settings):
        state, step = fresh(**settings)
        step(state, np.ones((8, 3), np.float32), jax.random.key(1))
        return step.latest.flops.total()

    assert products() - products(freeze=("trunk",)) == 2 * 8 * 3 * WIDTH + 2 * 8 * WIDTH * 2


@pytest.mark.parametrize(
    ("freeze", "text"),
    [
        (("trunks",), "freeze: no parameter is named 'trunks'; there are: head, trunk"),
        (("head.1",), "freeze: no parameter is named 'head.1'; there are below 'head': 0"),
        (("head.0.kern",), "no parameter is named 'head.0.kern'; there are below 'head.0': bias, kernel"),  # noqa: E501
        (("head", "trunk"), "freeze: head, trunk leaves nothing to train"),
    ],
)  # fmt: skip
def test_a_wrong_prefix_lists_what_there_is(freeze, text):
    with pytest.raises(ValueError) as error:
        fresh(freeze=freeze)
    assert text in str(error.value) and "\n" not in str(error.value)


def test_a_prefix_ends_at_a_dot():
    mask = frozen_mask({"out": 1, "out_layer": 2}, ("out",))
    assert mask == {"out": True, "out_layer": False}


def test_the_norms_are_checkpointed_and_reported(tmp_path):
    state, step = fresh(clip_percentile=50.0, clip_window=2, freeze=("trunk",))
    batch = np.ones((8, 3), np.float32)
    seen = []
    for _ in range(3):
        state, metrics = step(state, batch, jax.random.key(1))
        seen.append((float(metrics["grad_norm"]), float(metrics["clip_threshold"])))
    assert [t for _, t in seen[:2]] == [1.0, 1.0]
    assert seen[2][1] == pytest.approx(min(1.0, (seen[0][0] + seen[1][0]) / 2), rel=1e-5)
    with Checkpoints(tmp_path) as checkpoints:
        checkpoints.save(3, state, wait=True)
        back = checkpoints.restore(fresh(clip_percentile=50.0, clip_window=2, freeze=("trunk",))[0])
    for ours, theirs in zip(jax.tree.leaves(back), jax.tree.leaves(state), strict=True):
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(theirs))
    norms = [
        s
        for s in jax.tree.leaves(back.opt_state, is_leaf=lambda n: isinstance(n, RecentNorms))
        if isinstance(s, RecentNorms)
    ]
    assert float(norms[0].norms[0]) == pytest.approx(seen[2][0], rel=1e-6)


def test_nothing_changes_where_neither_is_asked_for():
    """A run of before goes on: the optimizer's state has the same names."""
    state, _ = fresh()
    names = {n.rpartition("trunk")[0] for n in flat_names(state.opt_state) if "trunk" in n}
    assert len(names) == 2 and not any("norms" in n for n in flat_names(state.opt_state))


def test_what_is_frozen_need_not_be_named_as_slow():
    ones = np.ones((2, 2), np.float32)
    params = {"backbone": {"kernel": ones}, "legs": {"kernel": ones}}
    stage = StageConfig(slow=("backbone",), freeze=("backbone",), warmup_steps=0)
    optimizer = make_optimizer(stage)
    run = jax.jit(lambda tree: optimizer.update(tree, optimizer.init(tree), tree)[0])
    updates = jax.device_get(run(params))
    np.testing.assert_array_equal(updates["backbone"]["kernel"], 1)  # as given: masked by the step
    assert (updates["legs"]["kernel"] < 0).all()
