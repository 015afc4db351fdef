"""Batches of layouts: they begin where they are told, resume, are shared and mirrored, and show a
share of their pictures as if cut out of photographs."""

import dataclasses

import numpy as np
import pytest
from hand_records import first_of

from uniart_jax.config import DataConfig, GridConfig, LayoutConfig, ModelConfig
from uniart_jax.data import layout_batches, layouts
from uniart_jax.data.mirror import (
    mirror_boxes,
    mirror_codes,
    mirror_corners,
    mirror_legs,
    mirror_revolutions,
)
from uniart_jax.voxels.joint_code import gauge_variants
from uniart_jax.voxels.typed_batches import BOX_SETS

SETTINGS = layouts.LayoutSettings(image_size=32)
MODEL = ModelConfig(grid=GridConfig(32, 4, 16), layout=LayoutConfig(image_size=32))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layouts")
    with pytest.MonkeyPatch.context() as patch:
        for module in (layouts, layout_batches):
            patch.setattr(module, "BLOCK", 3)
        patch.setattr(layout_batches, "WINDOW", 2)
        layout_batches._window.cache_clear()
        layout_batches._shuffled.cache_clear()
        yield DataConfig(layouts=str(folder / "blocks"), reuse=2)
        layout_batches._window.cache_clear()
        layout_batches._shuffled.cache_clear()


def taken(data, count, state=None, **shares):
    """The first batches of two. A few are made ahead, and every block of objects takes long, so
    they are no larger."""
    return first_of(layout_batches.layout_batches(data, MODEL, 2, **shares), count, state)


def test_a_training_begins_at_its_first_block(data):
    """What it shows in a window is those blocks' objects, each ``reuse`` times; none is of
    others."""
    later = dataclasses.replace(data, first_block=2, mirror=False)
    shown = np.concatenate([batch.boxes for batch in taken(later, 6)])  # 12: a whole window
    settings = layouts.settings_of(data, MODEL)
    held = np.concatenate([layouts.load_block(data.layouts, n, settings)["boxes"] for n in (2, 3)])
    places = [np.flatnonzero((held == boxes).all((1, 2))).tolist() for boxes in shown]
    assert sorted(places) == sorted([[k] for k in range(6)] * 2)
    wrong = {"first_block": -1, "photographs": 5, "box_sets_every": 0}
    for name, value in wrong.items():
        given, said = {name: value}, f"{name} is {value};"
        with pytest.raises(ValueError, match=f"config: data.*{said}"):
            layout_batches.layout_batches(dataclasses.replace(data, **given), MODEL, 4)


def test_batches_resume_and_are_shared(data):
    whole = taken(data, 7)  # the last is of the second window
    later = taken(data, 1, state={"batch": 6, "batch_size": 2})[0]
    np.testing.assert_array_equal(later.image, whole[6].image)
    halves = [taken(data, 1, process_index=i, process_count=2)[0] for i in (0, 1)]
    np.testing.assert_array_equal(np.concatenate([h.boxes for h in halves]), whole[0].boxes)


def test_one_batch_of_several_has_legs_panels_and_boards(data):
    """The rest of the others is as it would be with them."""
    for number, (some, whole) in enumerate(
        zip(taken(dataclasses.replace(data, box_sets_every=3), 5), taken(data, 5), strict=True)
    ):
        for name, value in whole._asdict().items():
            held = getattr(some, name)
            if number % 3 and name in BOX_SETS:
                assert held is None
            else:
                np.testing.assert_array_equal(held, value, err_msg=name)
    assert {"legs", "panels", "boards"} < set(BOX_SETS) and "revolutions" not in BOX_SETS


def test_mirrored_items_belong_together(data):
    layouts.check_settings(data.layouts, SETTINGS)
    table = layout_batches.load_window(data.layouts, 0, SETTINGS)
    plain = layout_batches._item(table, 1, 0.0, False)
    turned = layout_batches._item(table, 1, 0.0, True)
    np.testing.assert_array_equal(turned.image, plain.image[:, ::-1])
    np.testing.assert_array_equal(turned.boxes, mirror_boxes(plain.boxes))
    assert plain.leg_counts > 0
    np.testing.assert_array_equal(turned.legs, mirror_legs(plain.legs))
    assert (turned.legs != plain.legs).any()
    assert plain.panel_counts > 0
    np.testing.assert_array_equal(turned.panels, mirror_corners(plain.panels))
    assert (turned.panels != plain.panels).any() and plain.panel_share > 0
    assert max(plain.board_counts) > 0 and max(plain.board_share) > 0
    np.testing.assert_array_equal(turned.boards, mirror_corners(plain.boards))
    assert (turned.boards != plain.boards).any()
    np.testing.assert_array_equal(turned.revolutions, mirror_revolutions(plain.revolutions))
    back = mirror_codes(turned.codes)
    assert np.abs(gauge_variants(back) - plain.codes[:, None]).max(-1).min(-1).max() < 1e-5


def test_a_share_is_shown_as_photographs(data):
    """Others each time, with the truth of the same objects; the rest is as without."""
    plain, mixed, all_of_them = (
        taken(dataclasses.replace(data, photographs=share), 6) for share in (0.0, 0.5, 1.0)
    )
    pictures = [np.concatenate([b.image for b in run]) for run in (plain, mixed, all_of_them)]
    for run in (mixed, all_of_them):
        for batch, true in zip(run, plain, strict=True):
            np.testing.assert_array_equal(batch.boxes, true.boxes)
            np.testing.assert_array_equal(batch.codes, true.codes)
            assert np.abs(batch.camera - true.camera).max() < 0.4
    same = [(pictures[0][k] == pictures[1][k]).all() for k in range(12)]
    assert 2 <= sum(same) <= 10
    assert not any((pictures[0][k] == pictures[2][k]).all() for k in range(12))
    assert len({picture.tobytes() for picture in pictures[2]}) == 12  # each object is there twice
    black = pictures[2][pictures[0].max(-1) == 0]
    assert (black.max(-1) < 0.1).mean() > 0.8  # cut out again
