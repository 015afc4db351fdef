"""Losses: gauges, padding, balance."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax.config import Config, FlowConfig, LossConfig
from uniart_jax.training import losses
from uniart_jax.training.flow_losses import (
    make_latent_flow_loss,
    normalize,
    sample_noise_and_time,
)
from uniart_jax.training.found_layouts import matching_rows
from uniart_jax.training.losses import part_weights
from uniart_jax.training.vae_losses import alignment_loss, make_uniart_vae_loss
from uniart_jax.voxels.joint_code import gauge_variants
from uniart_jax.voxels.part_table import PartTable
from uniart_jax.voxels.typed_batches import Condition, VoxelBatch

CODE = st.lists(st.floats(-1, 1, width=32), min_size=9, max_size=9).map(np.float32)


code_loss = jax.jit(losses.joint_code_loss)


@given(CODE, CODE)
def test_joint_code_loss_is_blind_to_the_gauge(predicted, target):
    variants = np.asarray(gauge_variants(target), np.float32)
    values = [float(code_loss(predicted, v, 0.3)) for v in variants[:2]]
    assert values[0] == pytest.approx(values[1], abs=1e-6)
    assert float(code_loss(variants[1], target, 0.3)) == pytest.approx(0, abs=1e-6)


def test_a_wrong_opening_direction_costs():
    opens_out = np.float32([0, 0, 0, 1, 0, 0, 0, 0, 0.5])
    opens_in = np.float32([0, 0, 0, 1, 0, 0, 0, -0.5, 0])
    assert float(code_loss(opens_in, opens_out, 0.3)) > 0.05


def test_masked_mean_ignores_garbage_and_weighs_objects_equally():
    values = np.float32([[1, 3, np.nan], [10, np.inf, np.nan]])
    weights = np.float32([[1, 1, 0], [1, 0, 0]])
    mean, gradient = jax.jit(jax.value_and_grad(losses.masked_mean))(values, weights)
    assert float(mean) == pytest.approx((2 + 10) / 2)
    assert np.isfinite(gradient).all() and not np.asarray(gradient)[weights == 0].any()


def test_huber_and_boxes_by_hand():
    found = jax.jit(losses.huber)(np.float32([0.1, -1.0]), 0.5)
    np.testing.assert_allclose(found, [0.01, 0.75], atol=1e-6)
    a = np.float32([0, 0, 0, 2, 2, 2])
    b = np.float32([1, 0, 0, 2, 2, 2])  # both x corners moved by 1
    assert float(jax.jit(losses.box_loss)(a, b, 0.5)) == pytest.approx(2 * 0.75 / 6)


def test_kl_is_zero_at_the_prior_and_by_hand():
    mask, zero = np.float32([[1, 0]]), np.zeros((1, 2, 3), np.float32)
    kl_loss = jax.jit(losses.kl_loss)
    assert float(kl_loss(zero, zero, mask)) == 0
    mean = zero.copy()
    mean[0, 0], mean[0, 1] = 2, np.nan
    assert float(kl_loss(mean, zero, mask)) == pytest.approx(2.0)


def test_kl_is_the_closed_form_of_two_gaussians():
    """log(s2 / s1) + (s1^2 + (m1 - m2)^2) / (2 s2^2) - 1/2 with m2 = 0, s2 = 1, per element."""
    rng = np.random.default_rng(0)
    mean, logvar = rng.normal(size=(2, 2, 5, 3))
    deviation = np.exp(logvar / 2)
    each = np.log(1 / deviation) + (deviation**2 + mean**2) / 2 - 0.5
    expected = (each[0, :4].mean() + each[1, :2].mean()) / 2  # the mean of objects
    mask = np.arange(5) < np.array([[4], [2]])
    found = jax.jit(losses.kl_loss)(*(np.float32(a) for a in (mean, logvar, mask)))
    assert float(found) == pytest.approx(expected, rel=1e-5)


class Told:
    """A UniArt VAE that answers what it was given."""

    def __init__(self, **answers):
        self.answers = {name: jnp.asarray(value, jnp.float32) for name, value in answers.items()}

    def apply(self, params, *_, method):
        encoded = ("mean", "logvar", "geometry", "articulation")
        return {k: v for k, v in self.answers.items() if (k in encoded) == (method == "encode")}


def vae_case():
    """(network, batch) of one object of two parts and five voxels, the last of them padding."""
    rng = np.random.default_rng(4)
    f = lambda *s: rng.normal(size=(1, 5, *s)).astype(np.float32)  # noqa: E731
    answers = {
        "mean": f(2),
        "logvar": f(2),
        "geometry": f(3),
        "articulation": f(4),
        "sdf": f(8),
        "color": f(8, 3),
        "part_boxes": f(2, 6),
        "other_part": f(8),
        "joint_code": f(9),
        "parent_box": f(6),
        "part_feature": f(7),
    }
    batch = VoxelBatch(
        coords=np.zeros((1, 5, 3), np.int32),
        counts=np.array([4], np.int32),
        voxel_part=np.array([[0, 1, 1, 0, 0]], np.int32),
        owner=rng.integers(0, 2, (1, 5, 8)).astype(np.int32),
        parents=np.zeros((1, 2), np.int32),
        boxes=rng.normal(size=(1, 2, 6)).astype(np.float32),
        codes=rng.normal(size=(1, 2, 9)).astype(np.float32),
        sdf=f(8),
        color=np.abs(f(8, 3)),
        part_feature=f(7).astype(np.float16),
    )
    batch.part_feature[0, 4] = np.nan  # padding
    return Told(**answers), batch


def test_the_vaes_loss_is_the_weighted_sum_of_its_terms():
    """L_geo + lambda_1 L_art + L_own + lambda_2 L_kl, the weights the config's."""
    network, batch = vae_case()
    weights = dict(articulation=2.5, kl=0.7, color=0.3, alignment=0.4, part_feature=0.6)
    config = Config(loss=LossConfig(**weights))
    loss_fn = jax.jit(make_uniart_vae_loss(network, config))
    loss, terms = loss_fn({}, batch, jax.random.key(0))
    terms = {name: float(value) for name, value in terms.items()}
    assert all(terms[name] > 0.01 for name in terms if name != "padding")
    articulation = sum(terms[n] for n in ("own_box", "other_box", "joint_code", "parent_box"))
    expected = terms["occupancy"] + terms["sdf"] + 0.3 * terms["color"] + terms["foreign"]
    expected += 2.5 * (articulation + 0.6 * terms["part_feature"])
    expected += 0.7 * terms["kl"] + 0.4 * terms["alignment"]
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    answers, part = network.answers, batch.voxel_part[0, :4]
    mean, logvar, joint, parent = (
        np.asarray(answers[name], np.float64)[0, :4]
        for name in ("mean", "logvar", "joint_code", "parent_box")
    )
    kl = (mean**2 + np.exp(logvar) - 1 - logvar).mean() / 2  # of valid voxels alone
    assert terms["kl"] == pytest.approx(kl, rel=1e-4)

    def huber(error):
        return np.where(np.abs(error) < 0.3, error**2 / 0.6, np.abs(error) - 0.15).mean(-1)

    missed = np.asarray(answers["part_feature"])[0, :4] - batch.part_feature[0, :4]
    assert terms["part_feature"] == pytest.approx(huber(missed).mean(), rel=1e-3)
    gauges = np.asarray(gauge_variants(batch.codes[0, part]))
    joint = huber(joint[:, None] - gauges).min(1).mean()
    assert terms["joint_code"] == pytest.approx(joint, rel=1e-4)
    corners = [
        np.concatenate([b[..., :3] - b[..., 3:] / 2, b[..., :3] + b[..., 3:] / 2], -1)
        for b in (parent, batch.boxes[0, :1])
    ]
    assert terms["parent_box"] == pytest.approx(huber(corners[0] - corners[1]).mean(), rel=1e-4)


def test_latents_are_brought_to_mean_0_and_deviation_1():
    latent = np.random.default_rng(1).normal([3, -5], [0.5, 4], (2000, 2))
    found = normalize(np.float32(latent), latent.mean(0), latent.std(0))
    found = np.asarray(found, np.float64)
    np.testing.assert_allclose(found.mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(found.std(0), 1, atol=1e-4)


def test_geometry_losses_vanish_on_the_truth():
    rng = np.random.default_rng(0)
    sdf = np.float32(rng.choice([-3, 3], (2, 5, 8)))
    color = np.float32(rng.random((2, 5, 8, 3)))
    measure, ones = jax.jit(losses.geometry_losses), np.ones((2, 5), np.float32)
    found = measure({"sdf": sdf, "color": color}, sdf, color, ones)
    assert (
        float(found["sdf"]) == 0 and float(found["color"]) == 0 and float(found["occupancy"]) < 0.01
    )
    wrong = measure({"sdf": -sdf, "color": color}, sdf, color, ones)
    assert float(wrong["occupancy"]) > 3 and float(wrong["sdf"]) > 3


def test_balanced_voxels_hear_small_parts_and_never_padding():
    part = np.zeros((2, 1000), np.int32)
    part[0, 990:995] = 3  # five voxels of one part among 995
    part[1, :] = 1
    counts = np.array([995, 10])
    draw_voxels = jax.jit(losses.balanced_voxels, static_argnums=(3, 4))
    drawn = np.asarray(draw_voxels(jax.random.key(0), part, counts, 4000, 8))
    assert drawn[0].max() < 995 and drawn[1].max() < 10
    assert 0.45 < (part[0][drawn[0]] == 3).mean() < 0.55


def test_rows_are_drawn_by_weight_and_never_without():
    weights = np.float32([[0, 1, 0, 3, 0], [0, 0, 2, 0, 0]])
    draw_rows = jax.jit(losses.draw_rows, static_argnums=2)
    drawn = np.asarray(draw_rows(jax.random.key(0), weights, 4000))
    assert set(drawn[0]) == {1, 3} and set(drawn[1]) == {2}
    assert 0.7 < (drawn[0] == 3).mean() < 0.8
    nothing = np.asarray(draw_rows(jax.random.key(0), np.zeros((2, 5), np.float32), 4000))
    assert nothing.min() >= 0 and nothing.max() < 5


def test_part_weights_halve_between_rows_and_parts():
    parts, mask = np.int32([[0, 0, 0, 1, 1]]), np.float32([[1, 1, 1, 1, 0]])
    weights = jax.jit(part_weights, static_argnums=2)(parts, mask, 4)[0]
    np.testing.assert_allclose(
        weights, [0.5 * (1 / 4 + 1 / 6)] * 3 + [0.5 * (1 / 4 + 1 / 2), 0], atol=1e-6
    )
    assert float(weights.sum()) == pytest.approx(1)


def test_alignment_loss_knows_rotations():
    rng = np.random.default_rng(0)
    a = np.float32(rng.normal(size=(1, 50, 4)))
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    valid = np.ones((1, 50), np.float32)
    loss = jax.jit(alignment_loss)
    assert float(loss(a, np.float32(a @ turn * 3), valid)) == pytest.approx(0, abs=1e-4)
    assert float(loss(a, np.float32(rng.normal(size=(1, 50, 4))), valid)) > 0.5
    garbage = a.copy()
    garbage[:, 40:] = np.nan
    valid[:, 40:] = 0
    assert np.isfinite(float(loss(garbage, garbage, valid)))


def test_dice_and_cross_entropy():
    target, sure = np.float32([[1, 0, 1]]), np.float32([[20, -20, 20]])
    entropy = jax.jit(losses.binary_cross_entropy)
    assert float(jax.jit(losses.dice_loss)(sure, target)) == pytest.approx(0, abs=1e-5)
    assert np.asarray(entropy(sure, target)).max() < 1e-6
    assert np.asarray(entropy(-sure, target)).min() > 10


def test_part_share_says_how_much_of_the_weight_is_the_parts():
    parts, mask = np.int32([[0, 0, 0, 1, 2]]), np.float32([[1, 1, 1, 1, 0]])
    weigh = jax.jit(part_weights, static_argnums=2)
    np.testing.assert_allclose(weigh(parts, mask, 4, 0.0)[0], [0.25] * 4 + [0], atol=1e-6)
    np.testing.assert_allclose(weigh(parts, mask, 4, 1.0)[0], [1 / 6] * 3 + [0.5, 0], atol=1e-6)


def test_a_dropped_condition_is_nothing_in_all_its_parts():
    """Of an item that is shown no image, tokens, volume, pictures and cameras are zero together; of
    the others all are as they were."""
    shapes = {
        "tokens": (64, 3, 4),
        "volume": (64, 2, 2, 2, 3),
        "pixels": (64, 2, 4, 4, 3),
        "cameras": (64, 2, 7),
    }
    layout = PartTable(*(np.ones((64, *n), np.int32) for n in ((2, 6), (2, 9), (2,), (2, 3), ())))
    ones = {name: np.ones(s, np.float32) for name, s in shapes.items()}
    whole, x = Condition(**ones, layout=layout), np.zeros((64, 5, 4), np.float32)

    @jax.jit
    def shown(share, key):
        config = dataclasses.replace(Config(), loss=LossConfig(condition_drop=share))
        return sample_noise_and_time(jax.tree.map(jnp.asarray, whole), x, key, config)[-1]

    for share in (0.0, 0.4, 1.0):
        seen = shown(share, jax.random.key(0))
        kept = [np.asarray(a).reshape(64, -1) for a in jax.tree.leaves(seen)]
        assert len(kept) == 9 and all(np.array_equal(a.min(1), a.max(1)) for a in kept)
        assert all(np.array_equal(a[:, 0], kept[0][:, 0]) for a in kept)
        assert abs(kept[0][:, 0].mean() - (1 - share)) < 0.25
        assert kept[0][:, 0].mean() == 1 - share or share == 0.4


def test_true_parts_are_matched_to_the_rows_found_of_them():
    generator = np.random.default_rng(2)
    boxes = np.zeros((2, 4, 6), np.float32)
    boxes[..., :3] = generator.uniform(-0.4, 0.4, (2, 4, 3))
    boxes[..., 3:] = generator.uniform(0.05, 0.5, (2, 4, 3))
    order, counts = [2, 0, 3, 1], np.array([4, 2], np.int32)
    rows = boxes[:, order] + generator.normal(0, 0.003, (2, 4, 6))
    rows[0, 1, :3] += 0.3  # the row of part 0 lies too far off
    rows[1] = boxes[1]  # its rows 2 and 3 do not exist, nor do its parts
    found = PartTable(np.float32(rows), None, None, None, np.array([4, 1], np.int32))
    matched = jax.jit(matching_rows)(found, boxes, counts).tolist()
    assert matched == [[-1, 3, 0, 2], [0, -1, -1, -1]]


def test_the_latent_flow_weighs_parts_and_readouts_as_told():
    """A network that always answers 0: what its loss is can be said beforehand."""

    class Zero:
        def apply(self, params, x, t, *_, **__):
            return x / jnp.maximum(t, 0.05)[:, None, None]  # x_0 = 0 at every t above the floor

    latent = np.zeros((1, 4, 3), np.float32)
    latent[0, 3] = [1, 2, 0]  # the only voxel of part 1
    batch = VoxelBatch(
        coords=jnp.zeros((1, 4, 3), int),
        counts=jnp.array([4]),
        voxel_part=jnp.array([[0, 0, 0, 1]]),
        latent=jnp.asarray(latent),
        plans={"flow": None},
        seen=Condition(jnp.zeros((1, 2, 3)), jnp.zeros((1, 2, 2, 2, 3))),
    )
    readout = np.diag([0.0, 1.0, 0.0]).astype(np.float32)
    for share, metric, expected in (
        (0.0, None, 5 / 3 / 4),
        (1.0, None, 5 / 3 / 2),
        (0.0, readout, 4 / 4),
        (1.0, readout, 4 / 2),
    ):
        config = Config(loss=LossConfig(part_share=share, noise_share=1.0))
        config = dataclasses.replace(
            config,
            model=dataclasses.replace(
                config.model, latent_flow=FlowConfig(prediction="data", patch_size=1)
            ),
        )
        loss = make_latent_flow_loss(Zero(), config, np.zeros(3), np.ones(3), metric)
        found, metrics = jax.jit(loss)({}, batch, jax.random.key(0))
        np.testing.assert_allclose(found, expected, rtol=1e-5)
        np.testing.assert_allclose(metrics["x0_error"], 5 / 3 / 4, rtol=1e-5)
    with pytest.raises(ValueError, match=r"loss\.part_share is 1\.5"):
        make_latent_flow_loss(
            Zero(), Config(loss=LossConfig(part_share=1.5)), np.zeros(3), np.ones(3)
        )
