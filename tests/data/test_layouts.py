"""Blocks of pictures and part tables: functions of their number, never of a held-out seed."""

import dataclasses

import numpy as np
import pytest

from uniart_jax import procedural
from uniart_jax.config import DataConfig, GridConfig, LayoutConfig, ModelConfig
from uniart_jax.data import layouts
from uniart_jax.data.layout_batches import layout_batches
from uniart_jax.data.legs import legs_of
from uniart_jax.data.panels import boards_of, panels_of
from uniart_jax.data.revolutions import revolutions_of
from uniart_jax.voxels.part_table import MOST_BOARDS, MOST_LEGS, MOST_PANELS
from uniart_jax.voxels.revolution_table import revolution_rows

SETTINGS = layouts.LayoutSettings(image_size=32)
MODEL = ModelConfig(grid=GridConfig(32, 4, 16), layout=LayoutConfig(image_size=32))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layouts")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layouts, "BLOCK", 3)
        yield DataConfig(layouts=str(folder / "blocks"), reuse=2)


def test_no_held_out_or_validation_seed_is_trained_on():
    reserved = range(DataConfig.validation_seed, 10 * procedural.HELD_OUT_SEED)
    for number in (0, 899_999, 900_000, 999_999, 1_000_000, 5_000_000, 20_000_000):
        assert layouts.training_seed(number) not in reserved
    seeds = [layouts.training_seed(n) for n in range(899_990, 900_010)]
    assert len(set(seeds)) == len(seeds)
    assert layouts.training_seed(5, DataConfig.validation_seed) == 900_005
    with pytest.raises(ValueError, match="held-out"):
        layouts.training_seed(100_000, DataConfig.validation_seed)


def test_a_block_is_a_function_of_its_number(data):
    first, again = layouts.make_block(1, SETTINGS), layouts.make_block(1, SETTINGS)
    for name in layouts.COLUMNS:
        np.testing.assert_array_equal(first[name], again[name])
    other = layouts.make_block(2, SETTINGS)
    assert not np.array_equal(first["images"], other["images"])
    assert first["images"].shape == (3, 2, 32, 32, 3) and first["images"].max() > 60
    assert ((first["colors"] >= 0) & (first["colors"] <= 1)).all()


def test_legs_are_those_of_the_shown_state(data, monkeypatch):
    found = []

    def noted(closed, shown):
        found.append((closed, shown, legs_of(closed, shown)))
        return found[-1][-1] if len(found) < 3 else None

    monkeypatch.setattr(layouts, "legs_of", noted)
    block = layouts.make_block(0, SETTINGS)
    assert block["leg_counts"].tolist() == [len(found[0][2]), len(found[1][2]), -1]
    for item, (closed, shown, legs) in enumerate(found[:2]):
        np.testing.assert_array_equal(block["legs"][item], legs.table(MOST_LEGS))
        assert block["legs_alone"][item] == legs.alone
        boxes = np.asarray(shown.boxes)
        np.testing.assert_allclose(block["boxes"][item][: len(boxes)], boxes, atol=1e-6)
        assert closed.name == shown.name
    assert not block["legs"][2].any() and not block["legs_alone"][2]


def test_panels_are_those_of_the_shown_state(data, monkeypatch):
    found, given = [], []

    def noted(shown, legs):
        found.append(panels_of(shown, legs))
        item = len(found) - 1
        given.append((np.asarray(shown.boxes), legs.table(MOST_LEGS)))
        return found[-1] if item < 2 else None

    monkeypatch.setattr(layouts, "panels_of", noted)
    block = layouts.make_block(0, SETTINGS)
    assert block["panel_counts"].tolist() == [len(found[0]), len(found[1]), -1]
    assert max(block["panel_counts"]) > 0
    for item, panels in enumerate(found[:2]):
        np.testing.assert_array_equal(block["panels"][item], panels.table(MOST_PANELS))
        assert block["panel_share"][item] == np.float32(panels.share)
        boxes, legs = given[item]
        np.testing.assert_allclose(block["boxes"][item][: len(boxes)], boxes, atol=1e-6)
        np.testing.assert_array_equal(block["legs"][item], legs)
    assert not block["panels"][2].any() and block["panel_share"][2] == 0


def block_and_labels(monkeypatch, name, label):
    """A block, and for each item of it what ``label`` says of the parts; they are its parts."""
    found = []

    def noted(shown):
        found.append((label(shown), np.asarray(shown.boxes)))
        return found[-1][0]

    monkeypatch.setattr(layouts, name, noted)
    block = layouts.make_block(0, SETTINGS)
    for item, (_, boxes) in enumerate(found):
        np.testing.assert_allclose(block["boxes"][item][: len(boxes)], boxes, atol=1e-6)
    return block, [labels for labels, _ in found]


def test_revolutions_are_those_of_the_shown_parts(data, monkeypatch):
    block, found = block_and_labels(monkeypatch, "revolutions_of", revolutions_of)
    assert block["revolutions"][..., 0].any()
    for item, revolutions in enumerate(found):
        rows = revolution_rows(revolutions, SETTINGS.max_parts)
        np.testing.assert_array_equal(block["revolutions"][item], rows)


def test_boards_are_those_of_the_shown_parts(data, monkeypatch):
    block, found = block_and_labels(monkeypatch, "boards_of", boards_of)
    assert max(block["board_counts"].ravel()) > 0
    for item, boards in enumerate(found):
        for part in range(SETTINGS.max_parts):
            own = boards[part] if part < len(boards) else None
            count = -1 if own is None else len(own)
            assert block["board_counts"][item, part] == count
            if own is None:
                assert not block["boards"][item, part].any()
                continue
            np.testing.assert_array_equal(block["boards"][item, part], own.table(MOST_BOARDS))
            assert block["board_share"][item, part] == np.float32(own.share)


def test_pictures_are_rendered_larger_than_they_are_shown(data, monkeypatch):
    """As a user's are: some sharp and hard, some soft; never at the crop's own size."""
    asked, render = [], layouts.render

    def noted(obj, camera, size, samples):
        asked.append((size, samples))
        return render(obj, camera, size=size, samples=samples)

    monkeypatch.setattr(layouts, "render", noted)
    for number in range(3):
        assert layouts.make_block(number, SETTINGS)["images"].shape[2:] == (32, 32, 3)
    assert set(asked) == {(64, 1), (40, 4)}


def test_an_object_that_cannot_be_made_is_left_out_and_named(data, monkeypatch, caplog):
    whole, draw = layouts.make_block(1, SETTINGS), layouts.encodable_state

    def faulty(closed, rng):
        if closed.name.endswith("-4"):
            raise ValueError("box: expected lo < hi")
        return draw(closed, rng)

    monkeypatch.setattr(layouts, "encodable_state", faulty)
    block = layouts.make_block(1, SETTINGS)
    for name in layouts.COLUMNS:  # the others are what they were
        np.testing.assert_array_equal(block[name], whole[name][[0, 2]])
    assert "procedural object 4 is left out: box: expected lo < hi" in caplog.text


def test_a_damaged_block_is_made_again(data):
    layouts.check_settings(data.layouts, SETTINGS)
    whole = layouts.load_block(data.layouts, 0, SETTINGS)
    path = layouts.block_path(data.layouts, 0)
    path.write_bytes(path.read_bytes()[:500])
    again = layouts.load_block(data.layouts, 0, SETTINGS)
    np.testing.assert_array_equal(whole["boxes"], again["boxes"])


def test_other_settings_are_refused(data):
    layouts.check_settings(data.layouts, SETTINGS)
    with pytest.raises(ValueError, match="other settings"):
        layouts.check_settings(data.layouts, dataclasses.replace(SETTINGS, image_size=64))


def test_a_config_chooses_its_world_and_a_folder_keeps_to_it(tmp_path):
    seven, wide = (DataConfig(layouts=str(tmp_path), world=world) for world in ("seven", "wide"))
    assert layouts.settings_of(seven, MODEL).families == procedural.SEEN_FAMILIES
    settings = layouts.settings_of(wide, MODEL)
    assert settings.families == procedural.WORLDS["wide"]
    layouts.check_settings(tmp_path, settings)
    with pytest.raises(ValueError, match=r"other settings .families."):
        layout_batches(seven, MODEL, 4)


def test_prepare_takes_a_world(tmp_path, monkeypatch):
    from uniart_jax.cli.data import prepare

    asked, firsts = [], []
    monkeypatch.setattr(
        layouts, "prepare_layouts", lambda *args: asked.append(args[2]) or firsts.append(args[4])
    )
    prepare("layouts", out=tmp_path, world="wide")
    prepare("layouts", out=tmp_path, first_block=7)
    assert [s.families for s in asked] == [procedural.WORLDS[w] for w in ("wide", "seven")]
    assert firsts == [0, 7]
    with pytest.raises(ValueError, match="--first-block"):
        prepare("procedural", out=tmp_path, first_block=7)
    with pytest.raises(ValueError, match="--world"):
        prepare("procedural", out=tmp_path, world="wide", families=("oven",))
    with pytest.raises(ValueError, match="--world"):
        prepare("urdf", tmp_path, out=tmp_path, world="wide")
