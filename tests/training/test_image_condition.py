"""Losses of pictures in place of what an image encoder sees in them: views, found layouts, their
cameras."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.inference.samplers import FoundLayouts
from uniart_jax.training.flow_losses import with_image_condition
from uniart_jax.voxels.part_table import PartTable
from uniart_jax.voxels.typed_batches import Condition, StructureBatch


def test_a_loss_of_pictures_is_that_of_what_the_encoder_sees_in_them():
    def loss(params, batch, key, more=1):
        left = {name for name, value in batch._asdict().items() if value is not None}
        return more * params * (batch.seen.tokens * batch.structure).sum(), {"fields": left}

    def condition(encoder, images):
        return Condition(tokens=encoder * images)

    batch = StructureBatch(jnp.arange(3.0), image=jnp.ones(3))
    found, metrics = with_image_condition(loss, condition)(2.0, batch, None, (5.0,))
    assert found == 2 * 5 * 3 and metrics["fields"] == {"structure", "seen"}
    given = with_image_condition(loss, condition)(2.0, batch, None, (5.0, 7))
    assert given[0] == 7 * found


def test_a_loss_of_several_views_sees_all_of_them_and_the_layout_of_the_first():
    views = jnp.arange(2 * 3 * 4 * 4 * 3, dtype=jnp.float32).reshape(2, 3, 4, 4, 3)

    def condition(encoder, images):
        assert images.shape == (6, 4, 4, 3)
        return Condition(tokens=images.reshape(6, 16, 3), volume=images[:, None, None, None, 0, 0])

    def find(params, images):
        np.testing.assert_array_equal(images, views[:, 0])
        table = PartTable(*(jnp.ones((2, 1)) for _ in range(4)), jnp.ones(2))
        return FoundLayouts(table, jnp.zeros((2, 7)))

    def loss(params, batch, key):
        return jnp.zeros(()), batch.seen

    own = PartTable(*(jnp.zeros((2, 1)) for _ in range(4)), jnp.ones(2))
    seeing = with_image_condition(loss, condition, find, 1.0)
    batch = StructureBatch(None, image=views, layout=own)
    _, seen = seeing(None, batch, jax.random.key(0), (None, None))
    np.testing.assert_array_equal(seen.tokens, views.reshape(2, 48, 3))
    np.testing.assert_allclose(seen.volume[:, 0, 0, 0], views[:, :, 0, 0].mean(1))
    np.testing.assert_array_equal(seen.layout.boxes, 1)  # as found


def test_items_with_a_layout_are_seen_through_the_cameras_found_with_layouts():
    items, views = 3, 2

    def condition(encoder, images):
        pixels = jnp.zeros((len(images), 1, 2, 2, 4))
        return Condition(images, pixels=pixels, cameras=jnp.full((len(images), 1, 7), 5.0))

    def table(counts):
        return PartTable(*(jnp.ones((items, 1)) for _ in range(4)), jnp.array(counts))

    def find(params, images):
        cameras = jnp.arange(1.0, 4.0)[:, None] * jnp.ones((items, 7))
        return FoundLayouts(table([1, 1, 1]), cameras)

    def loss(params, batch, key):
        return jnp.zeros(()), batch.seen.cameras

    own = table([1, 0, 2])
    batch = StructureBatch(None, image=jnp.ones((items, views, 4, 4, 3)), layout=own)
    for share, through, first in (
        (0.0, False, [5, 5, 5]),
        (0.0, True, [1, 5, 3]),  # the second is shown no layout
        (1.0, True, [1, 2, 3]),  # it is shown the one that is found
    ):
        seeing = with_image_condition(loss, condition, find, share, through)
        _, cameras = seeing(None, batch, jax.random.key(0), (None, None))
        np.testing.assert_array_equal(cameras[:, 0], np.outer(first, np.ones(7)))
        np.testing.assert_array_equal(cameras[:, 1], 5)  # of another view it knows nothing


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_share_of_the_items_is_shown_the_layout_found_in_its_picture(share):
    items = 64
    own, found = (
        PartTable(*(jnp.full((items, *s), value) for s in ((2, 6), (2, 9), (2,), (2, 3), ())))
        for value in (1.0, 2.0)
    )

    def find(params, images):
        assert params == "layout's" and images.shape == (items, 3)
        return FoundLayouts(found, jnp.zeros((items, 7)))

    def loss(params, batch, key, vae):
        assert vae == "vae's"  # the layout network is not for the loss
        assert batch.layout is batch.seen.layout
        return jnp.zeros(()), {"layout": batch.layout}

    condition = lambda encoder, images: Condition(images)  # noqa: E731
    seeing = with_image_condition(loss, condition, find, share)
    frozen, batch = (
        ("encoder's", "vae's", "layout's"),
        StructureBatch(None, image=jnp.ones((items, 3)), layout=own),
    )
    table = seeing(None, batch, jax.random.key(3), frozen)[1]["layout"]
    chosen = np.asarray(table.counts) == 2
    assert {0.0: 0, 0.5: 32, 1.0: items}[share] == pytest.approx(
        chosen.sum(), abs=items * share * (1 - share)
    )
    for values in table:  # all of a table or nothing
        rows = np.asarray(values).reshape(items, -1)
        np.testing.assert_array_equal(rows, np.where(chosen, 2.0, 1.0)[:, None] + 0 * rows)
