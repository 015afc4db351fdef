"""A UniArt VAE whose decoder sees a layout: begins as it was, ignores padding, copies what its
pointers name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import build, finite, flow_table, init, vae_config, voxel_batch

from uniart_jax.models.layout_decoder import Refinement, pointed
from uniart_jax.training.vae_losses import pointer_loss

MODEL = vae_config(attention="serial", window=16, layout_channels=8)
VOXELS = np.int32([[0, 5, 60], [36, 2, 2]])
TAKEN = ("own_box", "joint_code", "parent_box")  # of rows


def with_layout(batch, **changes):
    return batch._replace(layout=flow_table()._replace(**changes))


def decode(network, params, batch):
    latent = np.random.default_rng(1).normal(size=(*batch.coords.shape[:2], 4)).astype(np.float32)
    return jax.jit(lambda p, b: network.apply(p, latent, b, VOXELS, method="decode"))(params, batch)


@pytest.mark.slow
def test_it_begins_as_the_decoder_that_sees_none():
    blind = vae_config(attention="serial", window=16)
    network, params = build("uniart_vae", MODEL), init(build("uniart_vae", MODEL))
    fresh = jax.jit(build("uniart_vae", MODEL).init)(jax.random.key(0))["layout"]
    params["layout"] = fresh  # init() of the toys draws zero layers too
    batch = voxel_batch(MODEL)
    found = decode(network, params, with_layout(batch))
    rest = {k: v for k, v in params.items() if k != "layout"}
    before = decode(build("uniart_vae", blind), rest, batch)
    for name in before.keys() - set(TAKEN):
        np.testing.assert_allclose(found[name], before[name], atol=1e-5, err_msg=name)
    nothing = decode(network, params, with_layout(batch, counts=jnp.zeros(2, jnp.int32)))
    for name in TAKEN:
        np.testing.assert_allclose(nothing[name], before[name], atol=1e-5, err_msg=name)


def test_padding_of_voxels_and_of_the_table_does_not_matter():
    network = build("uniart_vae", MODEL)
    params = init(network)

    @jax.jit
    def step(params, batch):
        def loss(params):
            latent = jnp.ones((*batch.coords.shape[:2], 4))
            out = network.apply(params, latent, batch, VOXELS, method="decode")
            return jnp.square(out["sdf"]).sum() + jnp.square(out["color"]).sum(), out

        return jax.grad(loss, has_aux=True)(params)

    gradient, clean = step(params, with_layout(voxel_batch(MODEL, 83)))
    assert finite(gradient) and np.asarray(gradient["layout"]["after_in"]["kernel"]).any()
    table = flow_table()
    beyond = np.arange(5)[None, :, None] >= np.asarray(table.counts)[:, None, None]
    boxes = np.where(beyond, np.float32(7), table.boxes)
    for width, garbage in ((83, np.nan), (83, 1e5), (70, None)):
        batch = with_layout(voxel_batch(MODEL, width, garbage=garbage), boxes=boxes)
        _, out = step(params, batch)
        for name in clean:
            np.testing.assert_allclose(out[name], clean[name], rtol=1e-4, atol=1e-5, err_msg=name)


def test_boxes_joints_and_parents_are_copied_from_the_row_that_wins():
    table = jax.device_get(flow_table())
    picks = np.zeros((2, 1, 4, 5), np.float32)
    picks[:, 0, 0, 2], picks[:, 0, 1, 1] = 1, 1
    logits = np.full((2, 1, 8, 5), -9.0, np.float32)
    logits[:, 0, :5, 0] = 9  # five sub-cells of row 2, two of row 1, one of none
    logits[:, 0, 5:7, 1] = 9
    logits[:, 0, 7, 4] = 9
    more = Refinement(np.zeros(0), np.zeros(0), logits, picks)
    other = {
        "own_box": np.full((2, 1, 8, 6), 5, np.float32),
        "joint_code": np.full((2, 1, 9), 5, np.float32),
        "parent_box": np.full((2, 1, 6), 5, np.float32),
    }
    out = jax.device_get(jax.jit(pointed)(table, more, other))
    for b in range(2):
        np.testing.assert_array_equal(out["own_box"][b, 0, :5], np.tile(table.boxes[b, 2], (5, 1)))
        np.testing.assert_array_equal(out["own_box"][b, 0, 6], table.boxes[b, 1])
        assert (np.asarray(out["own_box"])[b, 0, 7] == 5).all()
        np.testing.assert_array_equal(out["joint_code"][b, 0], table.codes[b, 2])
        parent = table.boxes[b, int(table.parents[b, 2])]
        np.testing.assert_array_equal(out["parent_box"][b, 0], parent)
    assert out["rows"].tolist() == [[[2, 1, -1, -1]]] * 2


def test_the_pointers_loss_is_least_where_the_owner_is_named():
    rows = np.int32([[1, 0, -1]])  # part 0 is the layout's row 1, part 2 was lost
    owner = np.int32([[[0, 1, 2]]])
    seen, run = {"rows": np.int32([[[0, 1, -1, -1]]])}, jax.jit(pointer_loss)
    right = np.full((1, 1, 3, 5), -20.0, np.float32)
    right[0, 0, 0, 1] = right[0, 0, 1, 0] = right[0, 0, 2, 4] = 20
    sdf, mask = np.zeros((1, 1, 3), np.float32), np.ones((1, 1), np.float32)

    def loss(logits):
        return float(run(seen | {"pointer": logits}, owner, rows, sdf, mask))

    assert loss(right) < 1e-6
    for cell in range(3):
        wrong = right.copy()
        wrong[0, 0, cell] = np.roll(wrong[0, 0, cell], 2)
        assert loss(wrong) > 5


def test_a_missing_layout_is_named():
    network = build("uniart_vae", MODEL)
    with pytest.raises(ValueError, match=r"give batch\.layout"):
        decode(network, init(network), voxel_batch(MODEL))
