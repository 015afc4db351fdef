"""The UniArt VAE at toy size: padding, its width and its content never matter; parts keep to
themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import MODEL, build, finite, init, vae_config, voxel_batch

from uniart_jax.config import ModelConfig, from_json, to_json
from uniart_jax.data.records import decode_color, decode_sdf
from uniart_jax.models.aggregation import AGGREGATIONS, Front
from uniart_jax.models.voxel_batch import cell_color, cell_sdf, voxel_boxes, voxel_codes
from uniart_jax.nn.blocks import linear


@pytest.mark.parametrize(
    ("attention", "linear_path", "qk_rms_norm"),
    [
        pytest.param("serial", True, False, id="serial"),
        pytest.param("swin", False, False, id="swin"),
        pytest.param("full", False, True, id="full", marks=pytest.mark.slow),
    ],
)
def test_uniart_vae_ignores_padding(attention, linear_path, qk_rms_norm):
    window = 16 if attention == "serial" else 4
    model = vae_config(
        attention=attention, window=window, linear_path=linear_path, qk_rms_norm=qk_rms_norm
    )
    network = build("uniart_vae", model)
    params = init(network)
    voxels = np.int32([[0, 5, 60], [36, 2, 2]])

    @jax.jit
    def step(params, batch):
        def loss(params):
            out = network.apply(params, batch, None, voxels)
            return sum(jnp.square(x).sum() for x in jax.tree.leaves(out)), out

        return jax.grad(loss, has_aux=True)(params)

    clean_gradient, clean = step(params, voxel_batch(model, 83))
    assert {k: v.shape for k, v in clean.items() if k not in ("geometry", "articulation")} == {
        "mean": (2, 83, 4),
        "logvar": (2, 83, 4),
        "latent": (2, 83, 4),
        "sdf": (2, 3, 8),
        "color": (2, 3, 8, 3),
        "part_boxes": (2, 3, 2, 6),
        "other_part": (2, 3, 8),
        "own_box": (2, 3, 8, 6),
        "joint_code": (2, 3, 9),
        "parent_box": (2, 3, 6),
    }
    assert finite(clean_gradient)
    assert all(np.asarray(g).any() for g in jax.tree.leaves(clean_gradient["decoder"]["blocks"]))
    others = [(83, np.nan), (83, 1e5)]  # of the same width: the same program
    for width, garbage in [*others, (70, None)] if attention == "serial" else others:
        batch = voxel_batch(model, width, garbage=garbage)
        gradient, out = step(params, batch)
        for name in ("sdf", "color", "own_box", "joint_code", "parent_box"):
            np.testing.assert_allclose(out[name], clean[name], rtol=1e-4, atol=1e-5)
        for b, n in enumerate(batch.counts):
            np.testing.assert_allclose(out["mean"][b, :n], clean["mean"][b, :n], atol=1e-5)
            assert not np.asarray(out["mean"])[b, n:].any()
        for a, b in zip(*map(jax.tree.leaves, (gradient, clean_gradient)), strict=True):
            np.testing.assert_allclose(a, b, rtol=2e-3, atol=2e-3 * np.abs(b).max())


SHARED = {"geometry", "code_in", "code_out", "part_feature"}
LAYERS = {
    "uniart": {"to_q", "to_kv", "to_out"},
    "self_attention": {"self_attn"},
    "residual": {"to_geometry"},
    "pooling": {"to_out"},
    "concat": {"fuse"},
}


def test_the_five_aggregations_run_and_differ():
    seen = []
    assert set(LAYERS) == set(AGGREGATIONS)
    for kind in LAYERS:
        options = {"num_blocks": 0, "visual_channels": 3, "part_feature_channels": 5}
        model = vae_config(aggregation=kind, **options)
        network = build("uniart_vae", model)
        batch = voxel_batch(model)
        mean = jax.jit(lambda p, b, n=network: n.apply(p, b, method="encode")["mean"])(
            init(network), batch
        )
        assert mean.shape == (2, 70, 4) and finite(mean)
        seen.append(np.asarray(mean))
        assert set(init(network)["front"]) - SHARED == LAYERS[kind]  # as checkpoints name them
    for i in range(5):
        for j in range(i):
            assert np.abs(seen[i] - seen[j]).max() > 1e-3


def test_a_new_aggregation_is_a_class_and_its_name(monkeypatch):
    """As docs/tutorial.md says; its checkpoint can be read again."""

    class GatedFront(Front):
        def make(self, rngs):
            self.gate = linear(self.art, self.geo, rngs, dtype=self.dtype)

        def aggregate(self, geometry, articulation, batch):
            gated = geometry * jax.nn.sigmoid(self.gate(articulation))
            return jnp.concatenate([gated, articulation], -1)

    monkeypatch.setitem(AGGREGATIONS, "gated", GatedFront)
    network = build("uniart_vae", vae_config(aggregation="gated", num_blocks=0))
    params = init(network)
    encode = jax.jit(lambda p, b: network.apply(p, b, method="encode")["mean"])
    mean = encode(params, voxel_batch(vae_config()))
    assert finite(mean) and "gate" in params["front"]
    model = vae_config(aggregation="gated")
    assert from_json(ModelConfig, to_json(model)) == model
    with pytest.raises(ValueError, match=r"aggregation 'mine' is none of uniart, .*, gated"):
        build("uniart_vae", vae_config(aggregation="mine")).abstract()


def test_part_attention_stays_within_the_part():
    model = vae_config(num_blocks=0, part_segment=0)
    network = build("uniart_vae", model)
    params = init(network)
    batch = voxel_batch(model)
    encode = jax.jit(lambda p, b: network.apply(p, b, method="encode")["mean"])
    before = np.asarray(encode(params, batch))
    changed = batch._replace(sdf=batch.sdf.copy())
    changed.sdf[0, 7] += 1.0
    difference = np.abs(np.asarray(encode(params, changed)) - before).max(-1)
    part = batch.voxel_part
    same = (part[0] == part[0, 7]) & (np.arange(70) < 61)
    assert (difference[0][same] > 0).all() and not difference[0][~same].any()
    assert not difference[1].any()


def front_by_loops(p, batch, heads):
    """V_geo, V_art and V of every voxel in float64, part by part and head by head."""
    p, batch = (
        jax.tree.map(lambda a: np.asarray(a, np.float64), x)
        for x in (p, batch._replace(plans=None))
    )

    def layer(name, x):
        return x @ p[name]["kernel"] + p[name]["bias"]

    for b, count in enumerate(batch.counts.astype(int)):
        part = batch.voxel_part[b, :count].astype(int)
        own = batch.owner[b, :count] == part[:, None]
        color = batch.color[b, :count].reshape(count, -1) * 2 - 1
        cells = np.concatenate([batch.sdf[b, :count], color, own], -1)
        geometry = np.concatenate([batch.visual[b, :count], layer("geometry", cells)], -1)
        boxes, parent = batch.boxes[b], batch.parents[b].astype(int)[part]
        code = layer(
            "code_in", np.concatenate([batch.codes[b][part], boxes[part], boxes[parent]], -1)
        )
        articulation = layer("code_out", code / (1 + np.exp(-code)))
        articulation = articulation + layer("part_feature", batch.part_feature[b, :count])
        q, (k, v) = layer("to_q", articulation), np.split(layer("to_kv", geometry), 2, -1)
        attended, size = np.zeros_like(articulation), articulation.shape[-1] // heads
        for one in np.unique(part):
            rows = np.flatnonzero(part == one)
            for h in range(heads):
                columns = slice(h * size, (h + 1) * size)
                logits = q[rows, columns] @ k[rows, columns].T / np.sqrt(size)
                weights = np.exp(logits - logits.max(1, keepdims=True))
                weights /= weights.sum(1, keepdims=True)
                attended[rows, columns] = weights @ v[rows, columns]
        fused = layer("to_out", attended) + articulation
        yield geometry, articulation, np.concatenate([geometry, fused], -1)


def test_the_attention_is_the_papers_equation_in_float64():
    """F_art = Attention(Q = V_art, K = V = V_geo) + V_art within a part, V = Concat(V_geo,
    F_art)."""
    model = vae_config(
        part_segment=0, articulation_channels=24, visual_channels=3, part_feature_channels=5
    )
    network = build("uniart_vae", model)
    params, batch = init(network), voxel_batch(model)
    found = jax.jit(lambda p, b: network.apply(p, b, method="front"))(params, batch)
    together, geometry, articulation = jax.device_get(found)
    for b, expected in enumerate(front_by_loops(params["front"], batch, heads=2)):
        rows = len(expected[0])
        for ours, theirs in zip((geometry, articulation, together), expected, strict=True):
            np.testing.assert_allclose(ours[b, :rows], theirs, rtol=1e-4, atol=1e-4)


def test_codes_and_boxes_are_gathered_by_part():
    batch = voxel_batch(MODEL)
    gather = jax.jit(lambda batch: (voxel_codes(batch), voxel_boxes(batch)))
    codes, found = jax.device_get(gather(batch))
    part = batch.voxel_part[1, 5]
    parent = batch.parents[1, part]
    expected = [batch.codes[1, part], batch.boxes[1, part], batch.boxes[1, parent]]
    np.testing.assert_array_equal(codes[1, 5], np.concatenate(expected))
    other_part = batch.owner != batch.voxel_part[..., None]
    np.testing.assert_array_equal(found["other_part"], other_part)
    np.testing.assert_array_equal(found["shared"], other_part.any(-1))
    b, v = np.argwhere(other_part.any(-1))[0]
    other = batch.owner[b, v][other_part[b, v]][0]
    np.testing.assert_array_equal(found["own"][b, v], batch.boxes[b, batch.voxel_part[b, v]])
    np.testing.assert_array_equal(found["other"][b, v], batch.boxes[b, other])
    chosen = jax.device_get(voxel_boxes(batch, np.int32([[1], [5]])))
    for name, values in chosen.items():
        np.testing.assert_array_equal(values[1, 0], found[name][1, 5])


def test_full_attention_reaches_the_whole_item_and_no_other():
    model = vae_config(attention="full", num_blocks=1)
    network = build("uniart_vae", model)
    params = init(network)
    batch = voxel_batch(model)._replace(plans=None)  # decoding reads none
    decode = jax.jit(lambda p, z, b: network.apply(p, z, b, method="decode")["sdf"])
    before = np.asarray(decode(params, batch.latent, batch))
    changed = batch.latent.copy()
    changed[0, 7] += 1.0
    difference = np.abs(np.asarray(decode(params, changed, batch)) - before).max(-1)
    assert (difference[0, :61] > 0).all()
    assert not difference[0, 61:].any() and not difference[1].any()


def test_query_and_key_norms_are_parameters_of_both_trunks():
    model = vae_config(qk_rms_norm=True)
    shapes = build("uniart_vae", model).abstract()
    for trunk in ("encoder", "decoder"):
        attention = shapes[trunk]["blocks"]["1"]["attn"]
        assert attention["q_rms_norm"]["gamma"].shape == (2, 12)
        assert attention["k_rms_norm"]["gamma"].shape == (2, 12)


def test_stored_cells_are_decoded_on_the_device():
    """What batches hold as bytes means the same as what ``data.records`` decodes; floats pass as
    they are."""
    steps = np.arange(-127, 128).astype(np.int8)
    np.testing.assert_allclose(cell_sdf(jnp.asarray(steps)), decode_sdf(steps), rtol=1e-6)
    bytes_ = np.arange(256).astype(np.uint8)
    np.testing.assert_allclose(cell_color(jnp.asarray(bytes_)), decode_color(bytes_), atol=1e-6)
    for cells in (cell_sdf, cell_color):
        np.testing.assert_array_equal(cells(jnp.linspace(-1, 1, 5)), jnp.linspace(-1, 1, 5))
