"""The image encoder at toy size: what it returns, and where its volume looks."""

import jax
import jax.numpy as jnp
import numpy as np
from toy import MODEL, build, finite, init

from uniart_jax.models.image_encoder import pixel_width


def test_image_encoder():
    network = build("image_encoder", MODEL)
    image = np.random.default_rng(0).random((2, 32, 32, 3), np.float32)
    params = init(network)

    @jax.jit
    def step(params, image):
        def loss(params):
            out = network.apply(params, image)
            return sum(jnp.square(out[k]).mean() for k in ("camera", "occupancy", "codes")), out

        return jax.value_and_grad(loss, has_aux=True)(params)

    (_, out), gradients = step(params, image)
    assert {k: v.shape for k, v in out.items()} == {
        "camera": (2, 7),
        "tokens": (2, 16, 16),
        "volume": (2, 4, 4, 4, 5 + 3),
        "occupancy": (2, 8, 8, 8),
        "codes": (2, 8, 8, 8, 21),
        "pixels": (2, 8, 8, pixel_width(MODEL.image_encoder)),
    }
    # the picture itself, in blocks, and the first stage, normalised
    blocks = np.asarray(out["pixels"][1, 2, 5, :48]).reshape(4, 4, 3)
    np.testing.assert_allclose(blocks, image[1, 8:12, 20:24] * 2 - 1, atol=1e-6)
    features = np.asarray(out["pixels"][..., 48:])
    np.testing.assert_allclose(features.mean(-1), 0, atol=1e-5)
    np.testing.assert_allclose(features.std(-1), 1, atol=1e-2)
    assert finite(gradients) and all(np.asarray(g).any() for g in jax.tree.leaves(gradients))


def test_image_encoder_looks_through_a_known_camera_only_where_told():
    network = build("image_encoder", MODEL)
    params = init(network)
    image = np.random.default_rng(0).random((2, 32, 32, 3), np.float32)
    camera = np.tile(np.float32([0.5, 0.8, 0.2, 1.5, 0.3, 0.1, 0.0]), (2, 1))
    apply = jax.jit(network.apply)
    alone = jax.device_get(apply(params, image))
    told = jax.device_get(apply(params, image, camera, np.array([False, True])))
    np.testing.assert_array_equal(told["camera"], alone["camera"])
    np.testing.assert_array_equal(told["occupancy"][0], alone["occupancy"][0])
    assert np.abs(told["occupancy"][1] - alone["occupancy"][1]).max() > 1e-4
    # straight from the front, a cell's colour is its picture's: the lower left quarter red
    front = np.tile(np.float32([0.0, 1.0, 0.0, 1.6, 1e-3, 0.0, 0.0]), (2, 1))
    red = np.zeros((2, 32, 32, 3), np.float32)
    red[:, 16:, :16, 0] = 1
    colors = np.asarray(apply(params, red, front, np.array([True, True]))["volume"][0, ..., 5:])
    assert (colors[:, 2:, :2, 0] > 0.9).all() and (colors[:, :2, :, 0] < -0.9).all()
    assert (colors[:, :, 2:, 0] < -0.9).all() and (colors[..., 1:] == -1).all()
    itself = apply(params, image, alone["camera"], np.array([True, True]))
    np.testing.assert_array_equal(itself["occupancy"], alone["occupancy"])


def test_image_encoder_reads_each_cell_where_the_camera_sees_it():
    network = build("image_encoder", MODEL)
    params = init(network)
    camera = np.float32([[0.0, 1.0, 0.0, 1.6, 1e-3, 0.0, 0.0]])  # straight from the front
    fine, coarse = np.zeros((1, 8, 8, 4), np.float32), np.zeros((1, 4, 4, 8), np.float32)
    mark = fine.copy()
    mark[0, 1, 6] = 1.0

    @jax.jit
    def lift(fine):
        places = network.apply(params, camera, method="project_cells")
        return network.apply(params, fine, coarse, camera, *places, method="lift")

    plain, marked = lift(fine), lift(mark)
    changed = np.abs(np.asarray(marked) - np.asarray(plain)).max(-1).reshape(4, 4, 4) > 1e-6
    # up and to the right in the picture is z > 0 and, seen along +x, y < 0; every depth alike
    assert changed.any((0,)).nonzero()[0].max() <= 1 and changed.any((0,)).nonzero()[1].min() >= 2
    assert changed.any() and (changed == changed[:1]).all()


def test_image_encoder_heads_lie_where_their_volume_cell_is():
    network = build("image_encoder", MODEL)
    params = init(network)
    image = np.zeros((1, 32, 32, 3), np.float32)
    params["head_token"] = jax.tree.map(np.zeros_like, params["head_token"])

    def corner(params):
        return network.apply(params, image)["occupancy"][0, 7, 0, 3]

    kernel = params["to_volume"][
        "kernel"
    ]  # [D, 2^3 cells x C]: cell (3, 0, 1) is cell (1, 0, 1) of token (1, 0, 0)
    gradient = jax.jit(jax.grad(corner))(params)["to_volume"]["kernel"].reshape(
        kernel.shape[0], 8, -1
    )
    touched = np.flatnonzero(np.abs(np.asarray(gradient)).sum((0, 2)))
    assert touched.tolist() == [0b101]
