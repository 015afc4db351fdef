"""Matching and losses of the layout network: invariances, and scipy's optimum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from copies import replaced
from scipy.optimize import linear_sum_assignment

from uniart_jax.config import LayoutConfig, ModelConfig, StageConfig
from uniart_jax.models.network import build
from uniart_jax.training.layout_loss import layout_losses, match_cost
from uniart_jax.training.matching import match
from uniart_jax.training.state import create_state, make_optimizer
from uniart_jax.training.step import make_train_step
from uniart_jax.voxels.joint_code import box_corners, gauge_variants
from uniart_jax.voxels.revolution_table import RADII, Revolution, revolution_rows
from uniart_jax.voxels.typed_batches import LayoutBatch

K, Q = 5, 8


@pytest.fixture(scope="module")
def setting():
    """A prediction and a batch of two objects, of 3 and 5 parts."""
    rng = np.random.default_rng(0)
    parts = [
        {
            "corners": rng.normal(size=(2, Q, 6)),
            "codes": rng.normal(size=(2, Q, 9)),
            "exists": rng.normal(size=(2, Q)),
            "colors": rng.random((2, Q, 3)),
        }
        for _ in range(2)
    ]
    out = {"parts": parts, "camera": rng.normal(size=(2, 7)), "parents": rng.normal(size=(2, Q, Q))}
    counts = np.array([3, 5])
    valid = np.arange(K) < counts[:, None]
    batch = LayoutBatch(
        boxes=np.abs(rng.normal(size=(2, K, 6))) * valid[..., None],
        codes=rng.normal(size=(2, K, 9)) * valid[..., None],
        colors=rng.random((2, K, 3)) * valid[..., None],
        parents=np.array([[0, 0, 1, 0, 0], [0, 0, 1, 2, 0]]),
        part_counts=counts,
        camera=rng.normal(size=(2, 7)),
        image=np.zeros((2, 4, 4, 3)),
    )
    cast = lambda x: x.astype(np.float32 if x.dtype.kind == "f" else np.int32)  # noqa: E731
    return jax.tree.map(cast, out), jax.tree.map(cast, batch)


losses = jax.jit(layout_losses)


def same(a, b):
    for name in a:
        np.testing.assert_allclose(a[name], b[name], rtol=2e-5, atol=1e-6, err_msg=name)


def test_matching_is_scipys():
    rng = np.random.default_rng(1)
    cost, counts = rng.normal(size=(6, Q, K)).astype(np.float32), np.array([1, 2, 3, 4, 5, 5])
    found = np.asarray(jax.jit(match)(cost, counts))
    for b, n in enumerate(counts):
        rows, columns = linear_sum_assignment(cost[b, :, :n])
        np.testing.assert_allclose(
            cost[b, found[b, :n], np.arange(n)].sum(), cost[b, rows, columns].sum(), rtol=1e-5
        )
        assert len(set(found[b].tolist())) == K


def test_garbage_in_padding_changes_nothing(setting):
    out, batch = setting
    padding = (0, slice(3, None))
    tables = {n: replaced(getattr(batch, n), padding, 1e6) for n in ("boxes", "codes", "colors")}
    spoiled = batch._replace(**tables, parents=replaced(batch.parents, padding, 4))
    same(losses(out, batch), losses(out, spoiled))


def test_the_order_of_the_true_parts_does_not_matter(setting):
    out, batch = setting
    order = np.array([2, 0, 1, 4, 3])
    place = np.argsort(order).astype(np.int32)
    moved = batch._replace(part_counts=np.int32([5, 5]))
    turned = {n: getattr(moved, n)[:, order] for n in ("boxes", "codes", "colors")}
    parents = place[moved.parents][:, order]
    same(losses(out, moved), losses(out, moved._replace(**turned, parents=parents)))


def test_the_order_of_the_queries_does_not_matter(setting):
    out, batch = setting
    order = np.random.default_rng(2).permutation(Q)
    parts = [{n: v[:, order] for n, v in part.items()} for part in out["parts"]]
    moved = {**out, "parts": parts, "parents": out["parents"][:, order][:, :, order]}
    same(losses(out, batch), losses(moved, batch))


def test_codes_are_compared_modulo_their_gauges(setting):
    out, batch = setting
    tau = batch.codes[..., :1]  # keep within one step, as true codes are
    usual = batch._replace(codes=replaced(batch.codes, np.s_[..., :1], np.tanh(tau)))
    variant = gauge_variants(usual.codes)[..., 1, :].astype(np.float32)
    a, b = losses(out, usual), losses(out, usual._replace(codes=variant))
    np.testing.assert_allclose(a["code"], b["code"], rtol=0.02)


def test_a_prediction_without_error_costs_next_to_nothing(setting):
    _, batch = setting
    rows = np.array([6, 1, 4, 0, 3])
    corners = np.concatenate(
        [batch.boxes[..., :3] - batch.boxes[..., 3:] / 2,
         batch.boxes[..., :3] + batch.boxes[..., 3:] / 2], -1
    )  # fmt: skip
    part = {
        "corners": replaced(np.full((2, Q, 6), 9, np.float32), np.s_[:, rows], corners),
        "codes": replaced(np.zeros((2, Q, 9), np.float32), np.s_[:, rows], batch.codes),
        "exists": np.full((2, Q), -20, np.float32),
        "colors": replaced(np.zeros((2, Q, 3), np.float32), np.s_[:, rows], batch.colors),
    }
    parents = np.full((2, Q, Q), -20, np.float32)
    for b, n in enumerate((3, 5)):
        part["exists"][b, rows[:n]] = 20
        parents[b, rows[:n], rows[batch.parents[b, :n]]] = 20
    out = {"parts": [part], "camera": batch.camera, "parents": parents}
    assert float(losses(out, batch)["loss"]) < 1e-4


@pytest.mark.slow
def test_muon_moves_hidden_matrices_and_a_small_network_learns():
    model = ModelConfig(
        layout=LayoutConfig(
            queries=Q, image_size=32, backbone="convolutions", map_channels=32, width=32, layers=1, heads=2,  # noqa: E501
            sketch_width=32, head_width=32,
        ),
    )  # fmt: skip
    network = build("layout", model)
    rng = np.random.default_rng(3)
    batch = LayoutBatch(
        image=rng.random((2, 32, 32, 3), np.float32),
        camera=rng.normal(size=(2, 7)).astype(np.float32),
        boxes=np.tile(np.float32([0, 0, 0, 0.5, 0.5, 0.5]), (2, K, 1)),
        codes=np.zeros((2, K, 9), np.float32),
        colors=np.full((2, K, 3), 0.5, np.float32),
        parents=np.zeros((2, K), np.int32),
        part_counts=np.array([2, 3], np.int32),
    )
    stage = StageConfig(
        steps=12, learning_rate=3e-3, muon=2.0, slow=("backbone",), schedule="linear",
        warmup_steps=2,
    )  # fmt: skip
    optimizer = make_optimizer(stage)
    from uniart_jax.config import Config, MeshConfig
    from uniart_jax.training.layout_loss import make_layout_loss
    from uniart_jax.training.sharding import make_mesh

    state = create_state(network.init, optimizer, jax.random.key(0), make_mesh(MeshConfig()))
    before = jax.tree.map(np.array, state.params)
    step = make_train_step(make_layout_loss(network, Config(model=model)), optimizer, 0.9)
    seen = []
    for _ in range(12):
        state, metrics = step(state, batch, jax.random.key(1))
        seen.append(float(metrics["loss"]))
    assert np.isfinite(seen).all() and seen[-1] < 0.7 * seen[0]
    moved = jax.tree.map(lambda a, b: float(np.abs(a - b).max()), before, state.params)
    assert moved["sketch2"]["kernel"] > 0 and moved["backbone"]["stages"]["0"]["down"]["kernel"] > 0


def test_boards_are_in_the_loss_at_the_query_of_their_part(setting):
    """A part's boards at the query that it was matched to cost nothing, at another they do."""
    out, batch = setting
    counts = batch.part_counts

    @jax.jit
    def matched(parts, batch):
        cost = match_cost(parts, box_corners(batch.boxes, jnp), batch.codes)
        return match(cost, batch.part_counts)

    query = np.asarray(matched(out["parts"], batch))
    lower, size = np.random.default_rng(4).random((2, 2, K, 3, 3), np.float32)
    boards = np.concatenate([lower, lower + size], -1)
    known = np.arange(K) < counts[:, None]
    batch = batch._replace(
        boards=boards,
        board_counts=np.where(known, np.int32(3), np.int32(-1)),
        board_share=known.astype(np.float32),
    )
    at = np.arange(2)[:, None], query, slice(3)
    rows = replaced(np.full((2, Q, 4, 6), 7, np.float32), at, boards)
    exists = replaced(np.full((2, Q, 4), -20, np.float32), at, 20)
    said = {"rows": [rows] * 2, "exists": [exists] * 2, "share": np.ones((2, Q), np.float32)}
    right = losses(out | {"boards": said}, batch)
    plain = losses(out, batch)
    assert abs(float(right["boards"])) < 1e-5 and "boards" not in plain
    np.testing.assert_allclose(right["loss"], plain["loss"], rtol=1e-5)
    turned = jax.tree.map(lambda x: np.roll(x, 1, axis=1), said)
    wrong = losses(out | {"boards": turned}, batch)
    assert float(wrong["boards"]) > 1
    np.testing.assert_allclose(wrong["loss"], plain["loss"] + wrong["boards"], rtol=1e-5)


def test_revolutions_are_in_the_loss_at_the_query_of_their_part(setting):
    """A round part at the query that it was matched to costs nothing, at another it does."""
    out, batch = setting

    @jax.jit
    def matched(parts, batch):
        cost = match_cost(parts, box_corners(batch.boxes, jnp), batch.codes)
        return match(cost, batch.part_counts)

    query = np.asarray(matched(out["parts"], batch))
    round_one = Revolution(1, np.array([0.1, -0.2]), np.full(RADII, 0.3))
    rows = np.stack(
        [revolution_rows([None, round_one], K), revolution_rows([None] * 4 + [round_one], K)]
    )
    batch = batch._replace(revolutions=rows)
    said = {
        "axis": np.tile(np.array([20.0, 0, 0, 0], np.float32), (2, Q, 1)),
        "centers": np.full((2, Q, 3, 2), 7, np.float32),
        "radii": np.full((2, Q, 3, RADII), 7, np.float32),
    }
    for item, part in ((0, 1), (1, 4)):
        at = item, query[item, part]
        said["axis"][at] = [0, 0, 20, 0]
        said["centers"][at][1], said["radii"][at][1] = round_one.center, round_one.radii
    right, plain = losses(out | {"revolutions": said}, batch), losses(out, batch)
    assert abs(float(right["revolutions"])) < 1e-5 and "revolutions" not in plain
    np.testing.assert_allclose(right["loss"], plain["loss"], rtol=1e-5)
    wrong = losses(out | {"revolutions": jax.tree.map(lambda x: np.roll(x, 1, 1), said)}, batch)
    assert float(wrong["revolutions"]) > 1
    np.testing.assert_allclose(wrong["loss"], plain["loss"] + wrong["revolutions"], rtol=1e-5)
