"""DINOv2 at toy size: order of the tokens, what the condition is, pictures of other sizes, masks.
Parity with upstream: tests of the fixtures."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import replaced
from toy import MODEL, finite, init

from uniart_jax.config import ImageEncoderConfig
from uniart_jax.models.dinov2 import IMAGE_MEAN, IMAGE_STD
from uniart_jax.models.network import build

ENCODER = ImageEncoderConfig(
    architecture="dinov2",
    image_size=16,
    patch_size=4,
    registers=3,
    width=24,
    num_blocks=2,
    num_heads=2,
)
NETWORK = build("image_encoder", dataclasses.replace(MODEL, image_encoder=ENCODER))


LOOK = jax.jit(NETWORK.apply)
FEATURES = jax.jit(functools.partial(NETWORK.apply, method="features"))
FINAL_NORM = jax.jit(functools.partial(NETWORK.apply, method="final_norm"))


@functools.partial(jax.jit, static_argnums=(1, 2))
def position_table(params, rows, columns):
    return NETWORK.apply(params, rows, columns, method="position_table")


@pytest.fixture(scope="module")
def params():
    return init(NETWORK)


def images(*shape):
    return np.random.default_rng(0).random((2, *shape, 3), np.float32)


def test_names_are_upstreams(params):
    names = {
        jax.tree_util.keystr(path, simple=True, separator=".")
        for path, _ in jax.tree_util.tree_leaves_with_path(params)
    }
    block = ["norm1.scale", "norm1.bias", "norm2.scale", "norm2.bias", "ls1.gamma", "ls2.gamma"]
    block += [
        f"{layer}.{leaf}"
        for layer in ("attn.qkv", "attn.proj", "mlp.fc1", "mlp.fc2")
        for leaf in ("kernel", "bias")
    ]
    assert names == {
        "cls_token", "pos_embed", "register_tokens", "mask_token", "norm.scale", "norm.bias",
        "patch_embed.proj.kernel", "patch_embed.proj.bias",
        *(f"blocks.{i}.{name}" for i in range(2) for name in block),
    }  # fmt: skip
    assert params["pos_embed"].shape == (1, 17, 24)
    assert params["patch_embed"]["proj"]["kernel"].shape == (4, 4, 3, 24)


def test_the_condition_is_the_normalised_tokens_and_patches_are_not(params):
    image = images(16, 16)
    out = LOOK(params, image)
    normal = (image - np.float32(IMAGE_MEAN)) / np.float32(IMAGE_STD)
    x = np.asarray(FEATURES(params, normal))
    assert out["tokens"].shape == x.shape == (2, 1 + 3 + 16, 24)
    assert out["patches"].shape == (2, 4, 4, 24)
    patches = np.asarray(out["patches"]).reshape(2, 16, 24)
    np.testing.assert_allclose(patches, x[:, 4:], atol=1e-5)
    centered = x - x.mean(-1, keepdims=True)
    deviation = np.sqrt(x.var(-1, keepdims=True) + 1e-5)
    np.testing.assert_allclose(out["tokens"], centered / deviation, atol=1e-4)
    normed = FINAL_NORM(params, x)
    expected = centered / np.sqrt(x.var(-1, keepdims=True) + 1e-6)
    expected = expected * np.asarray(params["norm"]["scale"]) + params["norm"]["bias"]
    np.testing.assert_allclose(normed, expected, atol=1e-4)


def test_tokens_are_cls_registers_patches_and_registers_have_no_position(params):
    """Without blocks, the tokens are what goes in."""
    flat = dataclasses.replace(ENCODER, num_blocks=0)
    network = build("image_encoder", dataclasses.replace(MODEL, image_encoder=flat))
    inputs = {name: value for name, value in params.items() if name != "blocks"}
    image = images(16, 16)
    x = np.asarray(jax.jit(functools.partial(network.apply, method="features"))(inputs, image))
    place = np.asarray(params["pos_embed"][0])
    np.testing.assert_allclose(x[0, 0], params["cls_token"][0, 0] + place[0], atol=1e-6)
    np.testing.assert_allclose(x[1, 1:4], params["register_tokens"][0], atol=1e-6)
    params = jax.device_get(params)
    proj = params["patch_embed"]["proj"]
    patch = image[1, 4:8, 12:16]  # row 1, column 3
    expected = np.einsum("abc,abcd->d", patch, proj["kernel"]) + proj["bias"] + place[1 + 4 + 3]
    np.testing.assert_allclose(x[1, 4 + 4 + 3], expected, atol=1e-5)


def test_other_picture_sizes(params):
    for shape in ((24, 24), (12, 20)):
        out = LOOK(params, images(*shape))
        rows, columns = shape[0] // 4, shape[1] // 4
        assert out["patches"].shape == (2, rows, columns, 24) and finite(out)
        assert out["tokens"].shape == (2, 4 + rows * columns, 24)
    # a table that is linear in the row stays so, upright, away from the border
    ramp = np.zeros((1, 17, 24), np.float32)
    ramp[:, 1:] = np.repeat(np.arange(4), 4)[None, :, None]
    _, table = position_table({**params, "pos_embed": ramp}, 8, 4)
    table = np.asarray(table).reshape(8, 4, 24)
    assert np.ptp(table, axis=(1, 2)).max() < 1e-5
    np.testing.assert_allclose(table[3:5, 0, 0], [1.25, 1.75], atol=0.05)
    with pytest.raises(ValueError, match="multiples of 4, not 18 x 16"):
        NETWORK.apply(params, images(18, 16))


def bicubic_antialiased(length, new):
    """[new, length] float64 weights of PyTorch's ``interpolate(mode="bicubic", antialias=True)``
    along an axis.

    Keys' cubic with a = -.5, as wide as the output's pitch where that is the coarser one;
    half-pixel centres; cut at the border and scaled to sum 1.
    """
    pitch = max(length / new, 1)
    weights = np.zeros((new, length))
    for i in range(new):
        center = (i + 0.5) * length / new
        for j in range(length):
            d = abs(j + 0.5 - center) / pitch
            near, far = 1.5 * d**3 - 2.5 * d**2 + 1, -0.5 * d**3 + 2.5 * d**2 - 4 * d + 2
            weights[i, j] = near if d <= 1 else far if d < 2 else 0
    return weights / weights.sum(1, keepdims=True)


@pytest.mark.parametrize("shape", [(6, 7), (3, 2), (2, 6)], ids=["larger", "smaller", "both"])
def test_positions_are_interpolated_as_pytorch_does(params, shape):
    """The fixture dinov2_interp holds upstream's own larger table; antialiasing shows in smaller
    ones."""
    first, table = position_table(params, *shape)
    places = np.asarray(params["pos_embed"], np.float64)[0, 1:].reshape(4, 4, 24)
    rows, columns = (bicubic_antialiased(4, n) for n in shape)
    expected = np.einsum("ia,jb,abd->ijd", rows, columns, places).reshape(1, -1, 24)
    np.testing.assert_allclose(table, expected, atol=1e-5)
    np.testing.assert_array_equal(first, params["pos_embed"][:, :1])


def test_masked_patches_are_not_looked_at(params):
    masks, image = np.zeros((2, 16), bool), images(16, 16)
    masks[0, 5], changed = True, replaced(image, np.s_[0, 4:8, 4:8], 0)

    def features(*given):
        return np.asarray(FEATURES(params, *given))

    seen, same = features(image, masks), features(changed, masks)
    np.testing.assert_allclose(seen, same, atol=1e-6)
    whole = features(image)
    assert np.abs(seen - whole)[0].max() > 1e-3
    assert np.abs(whole - features(changed))[0].max() > 1e-3


def test_gradients_are_finite_and_reach_everything(params):
    def loss(params):
        x = NETWORK.apply(params, images(16, 16), np.eye(2, 16, dtype=bool), method="features")
        return jnp.square(NETWORK.apply(params, x, method="final_norm") - 0.3).sum()

    gradients = jax.jit(jax.grad(loss))(params)
    assert finite(gradients) and all(np.asarray(g).any() for g in jax.tree.leaves(gradients))


def test_real_size_is_vit_large():
    large = ImageEncoderConfig(
        architecture="dinov2", image_size=518, width=1024, num_blocks=24, num_heads=16
    )
    shapes = build("image_encoder", dataclasses.replace(MODEL, image_encoder=large)).abstract()
    assert sum(leaf.size for leaf in jax.tree.leaves(shapes)) == 304_372_736
    assert shapes["pos_embed"].shape == (1, 1370, 1024)
