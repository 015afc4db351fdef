"""Forward mode, Hessian-vector products and vmap over parameters, through the networks of
``kernel`` 'plain' at toy size."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, build, flow_arguments, init, latent_config, vae_config, voxel_batch

from uniart_jax.config import LayoutConfig
from uniart_jax.nn.depthwise import depthwise_conv, sum_of_shifts
from uniart_jax.nn.grids import flow_plan

LAYOUT = LayoutConfig(
    queries=3, image_size=32, backbone="convolutions", map_channels=4, width=8, layers=1, heads=2,
    sketch_width=8, head_width=8,
)  # fmt: skip


def latent_case(**changes):
    model = latent_config(num_blocks=1, volume_channels=0, **changes)
    batch, (tokens, _, t) = voxel_batch(model), flow_arguments()
    voxels = {"coords": batch.coords, "counts": batch.counts}
    voxels["plan"] = flow_plan(batch.coords, batch.counts, model.latent_flow, model.grid)
    return "latent_flow", model, lambda f, p: f(p, batch.latent, t, tokens, **voxels)


def vae_case():
    model = vae_config(num_blocks=1)
    batch = voxel_batch(model)
    rows = jnp.asarray([[0, 5, 60], [36, 2, 2]])
    return "uniart_vae", model, lambda f, p: f(p, batch, None, rows)


def structure_flow_case():
    tokens, volume, t = flow_arguments()
    x = np.random.default_rng(0).normal(size=(2, 2, 2, 2, 3)).astype(np.float32)
    return "structure_flow", MODEL, lambda f, p: f(p, x, t, tokens, volume)


def structure_vae_case():
    occupancy = np.random.default_rng(0).integers(0, 2, (2, 8, 8, 8)).astype(np.float32)
    return "structure_vae", MODEL, lambda f, p: f(p, occupancy)


def image_encoder_case(**changes):
    encoder = dataclasses.replace(MODEL.image_encoder, **changes)
    image = np.random.default_rng(0).random((2, *[encoder.image_size] * 2, 3)).astype(np.float32)
    model = dataclasses.replace(MODEL, image_encoder=encoder)
    return "image_encoder", model, lambda f, p: f(p, image)


def layout_case(backbone="convolutions"):
    image = np.random.default_rng(0).random((1, 32, 32, 3)).astype(np.float32)
    layout = dataclasses.replace(LAYOUT, backbone=backbone)
    model = dataclasses.replace(MODEL, layout=layout)
    return "layout", model, lambda f, p: f(p, image)["parts"][-1]


CASES = {
    "conv": lambda: latent_case(stem="conv", io_channels=(6,), num_io_res_blocks=1),
    "patch": lambda: latent_case(stem="patch"),
    "vae": vae_case,
    "layout": layout_case,
    "efficientnet_lite0": lambda: layout_case("efficientnet_lite0"),
    "structure_flow": structure_flow_case,
    "structure_vae": structure_vae_case,
    "image_encoder": image_encoder_case,
    "dinov2": lambda: image_encoder_case(architecture="dinov2", image_size=28, width=24),
}


def made(case, kernel):
    """(outputs of parameters as one vector, the loss of them, parameters of a seed)."""
    name, model, call = CASES[case]()
    network = build(name, dataclasses.replace(model, kernel=kernel))

    def outputs(params):
        leaves = jax.tree.leaves(call(network.apply, params))
        return jnp.concatenate([leaf.reshape(-1) for leaf in leaves]) / 10

    return outputs, lambda p: jnp.square(outputs(p)).mean(), lambda seed: init(network, seed)


def derivatives(outputs, loss, params, v):
    """(f, J v), (grad, H v), both by forward mode."""
    return jax.jvp(outputs, (params,), (v,)), jax.jvp(jax.grad(loss), (params,), (v,))


def test_forward_mode_and_hessian_vector_products():
    """A slope along v by forward mode is the gradient's, H is symmetric, and the function is that
    of the usual kernel."""
    outputs, loss, draw = made("patch", "plain")
    usual = made("patch", "xla")[0]
    params, u, v = (draw(seed) for seed in range(3))

    def dot(a, b):
        return sum(jnp.vdot(x, y) for x, y in zip(*map(jax.tree.leaves, (a, b)), strict=True))

    @jax.jit
    def run(params, u, v):
        (out, along), (gradient, hv) = derivatives(outputs, loss, params, v)
        slopes = 2 * jnp.vdot(out, along) / len(out), dot(gradient, v)
        return (out, usual(params)), slopes, dot(u, hv)

    (ours, theirs), (forward, reverse), uhv = run(params, u, v)
    np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-4)
    assert forward == pytest.approx(float(reverse), rel=1e-3, abs=1e-4)
    assert uhv == pytest.approx(float(run(params, v, u)[2]), rel=2e-3, abs=1e-4)
    assert abs(float(forward)) > 1e-3 and abs(float(uhv)) > 1e-3


def refusals(jaxpr):
    """How often a program holds what JAX refuses to run forward: the tangent of a gradient of its
    own."""
    number = 0
    for equation in jaxpr.eqns:
        number += equation.primitive.name == "custom_lin"
        for value in jax.tree.leaves(equation.params, is_leaf=lambda p: hasattr(p, "eqns")):
            inner = getattr(value, "jaxpr", value)
            number += refusals(inner) if hasattr(inner, "eqns") else 0
    return number


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_every_network_lets_forward_mode_through(case):
    """Traced alone; with the usual kernel there is something that JAX refuses, but in the structure
    VAE, whose layers are all JAX's."""
    found = {}
    for kernel in ("plain", "xla"):
        outputs, loss, draw = made(case, kernel)
        params = jax.eval_shape(lambda draw=draw: draw(0))
        program = jax.make_jaxpr(lambda p, o=outputs, f=loss: derivatives(o, f, p, p))(params)
        found[kernel] = refusals(program.jaxpr)
    assert found["plain"] == 0 and (found["xla"] > 0) == (case != "structure_vae")


def test_vmap_over_parameters_is_each_network_by_itself():
    outputs, _, draw = made("patch", "xla")
    several = [draw(seed) for seed in range(2)]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *several)
    run = jax.jit(lambda stacked, one: (jax.vmap(outputs)(stacked), outputs(one)))
    together, alone = run(stacked, several[1])
    np.testing.assert_allclose(together[1], alone, rtol=1e-3, atol=1e-4)
    assert np.abs(together[0] - alone).max() > 0.01


def test_depthwise_convolutions_have_both_ways_of_a_derivative():
    stride = 2
    rng = np.random.default_rng(0)
    x, dx = rng.normal(size=(2, 1, 4, 6, 3)).astype(np.float32)
    kernel, w = rng.normal(size=(3, 3, 3)).astype(np.float32), jax.random.key(3)

    @jax.jit
    def run(x, dx, kernel):
        out, along = jax.jvp(lambda x: sum_of_shifts(x, kernel, stride), (x,), (dx,))
        theirs, back = jax.vjp(lambda x: depthwise_conv(x, kernel, stride), x)
        weights = jax.random.normal(w, out.shape)
        return out, theirs, jnp.vdot(along, weights), jnp.vdot(dx, back(weights)[0])

    out, theirs, forward, reverse = run(x, dx, kernel)
    np.testing.assert_allclose(out, theirs, atol=1e-6)
    assert forward == pytest.approx(float(reverse), rel=1e-4)
