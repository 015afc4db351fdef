"""Objects put together from a library's parts."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from uniart_jax import procedural
from uniart_jax.config import Config, GridConfig, ImageEncoderConfig, ModelConfig
from uniart_jax.data.image_table import load_image_table
from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.reconstruction import object_of_record
from uniart_jax.evaluation.retrieval import (
    THINNEST,
    PartLibrary,
    fit_to_box,
    make_library,
    make_retrieval,
    retrieve_parts,
    training_objects,
)
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.voxels.typed_batches import Condition

# no two parts of these have equal boxes
OWN = (("laptop", 3), ("bottle", 4), ("microwave", 6), ("trash_can", 2))


@pytest.fixture(scope="module")
def library() -> PartLibrary:
    return make_library([*training_objects(14), *OWN])


def hand_made(sizes, labels) -> PartLibrary:
    return PartLibrary(np.array(sizes, float), np.array(labels), ((("oven", 0), 0),) * len(sizes))


@pytest.mark.parametrize("source", OWN)
def test_an_object_whose_parts_are_in_the_library_is_reproduced(library, source):
    target = at_rest(procedural.generate(*source))
    for labels in (True, False):
        asked = target if labels else without_labels(target)
        found = retrieve_parts(asked, library)
        for k, (part, true) in enumerate(zip(found.parts, asked.parts, strict=True)):
            assert library.places[library.nearest(true.box[3:], true.label)] == (source, k)
            assert np.allclose(part.mesh.vertices, true.mesh.vertices, atol=1e-9)
            assert np.array_equal(part.mesh.faces, true.mesh.faces)
            assert part.joint is true.joint and part.parent == true.parent


def without_labels(obj: ArticulatedObject) -> ArticulatedObject:
    return dataclasses.replace(
        obj, parts=tuple(dataclasses.replace(p, label="") for p in obj.parts)
    )


def test_of_the_target_only_boxes_and_labels_count(library):
    target = at_rest(procedural.generate("washer", procedural.HELD_OUT_SEED + 5))
    blocks = tuple(
        dataclasses.replace(
            p,
            mesh=trimesh.creation.box(
                p.box[3:], trimesh.transformations.translation_matrix(p.box[:3])
            ),
        )
        for p in target.parts
    )
    found = retrieve_parts(target, library)
    same = retrieve_parts(dataclasses.replace(target, parts=blocks), library)
    assert np.allclose(found.boxes, target.boxes, atol=1e-9)
    for a, b in zip(found.parts, same.parts, strict=True):
        assert np.allclose(a.mesh.vertices, b.mesh.vertices, atol=1e-9)
    assert not any(
        len(a.mesh.faces) == 12 and a.label == "door" for a in same.parts
    )  # the library's, not the block


def test_labels_restrict_and_unknown_ones_do_not():
    library = hand_made([[1, 1, 1], [0.5, 0.1, 0.5], [0.5, 0.1, 0.6]], ["door", "drawer", "drawer"])
    size = np.array([0.5, 0.1, 0.55])
    assert library.nearest(size, "door") == 0
    assert library.nearest(size, "drawer") == 2  # log(.6 / .55) < log(.55 / .5)
    assert library.nearest(size) == library.nearest(size, "lever") == 2
    assert library.nearest(np.array([1.0, 1, 1]), "drawer") == 2


def test_the_distance_is_how_far_a_part_must_be_stretched():
    # .5 is twice from 1, and 2.5 times from .2, though .2 is nearer
    library = hand_made([[0.2, 1, 1], [1, 1, 1]], ["", ""])
    assert library.nearest(np.array([0.5, 1, 1])) == 1
    assert hand_made([[1, 1, 1], [1, 1, 1]], ["", ""]).nearest(np.ones(3)) == 0


@given(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.tuples(*[st.floats(0.002, 2)] * 3),
    st.tuples(*[st.floats(0.002, 2)] * 3),
)
def test_a_part_fills_its_box_and_is_not_turned_inside_out(center, size, own):
    mesh = trimesh.creation.box(own)
    mesh.apply_translation([3.0, -2.0, 1.0])
    fitted = fit_to_box(mesh, np.array([*center, *size]))
    lo, hi = fitted.bounds
    assert np.allclose((lo + hi) / 2, center, atol=1e-9) and np.allclose(hi - lo, size, atol=1e-9)
    assert np.isclose(fitted.volume, np.prod(size), rtol=1e-6)
    assert np.allclose(mesh.bounds[0], [3, -2, 1] - np.array(own) / 2)  # the source stays


@pytest.mark.parametrize("size", [(0.0, 0.4, 0.2), (0.0, 0.0, 0.2), (0.0, 0.0, 0.0)])
def test_boxes_without_thickness(library, size):
    flat = trimesh.Trimesh(
        np.array([[0.0, 0, 0], [1, 1, 0], [0, 1, 1]]) * size, [[0, 1, 2]], process=False
    )
    target = ArticulatedObject((Part("root", trimesh.creation.box()), Part("leaf", flat, 0)))
    found = retrieve_parts(target, library).parts[1]
    assert np.isfinite(found.mesh.vertices).all()
    assert np.allclose(found.box[3:], np.maximum(size, THINNEST), atol=1e-9)
    # and a sheet of the library, asked for a block, stays a sheet
    sheet = trimesh.Trimesh([[0.0, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2]], process=False)
    fitted = fit_to_box(sheet, np.array([0, 0, 0, 0.3, 0.5, 0.5]))
    assert np.isfinite(fitted.vertices).all()
    assert np.allclose(fitted.bounds[1] - fitted.bounds[0], [0, 0.5, 0.5])


def test_held_out_objects_and_nothing_are_refused():
    with pytest.raises(ValueError, match="held-out objects \\(seed 1000000\\)"):
        make_library([("oven", 3), ("oven", procedural.HELD_OUT_SEED)])
    with pytest.raises(ValueError, match="it has no objects"):
        make_library([])


def test_the_library_holds_training_objects_in_the_order_they_are_prepared(library):
    assert training_objects(9)[:1] == [("storage_furniture", 0)]
    assert training_objects(9)[8] == (procedural.SEEN_FAMILIES[1], 8)
    assert library.places[0] == (("storage_furniture", 0), 0)
    obj = at_rest(procedural.generate("storage_furniture", 0))
    assert np.allclose(library.sizes[: len(obj.parts)], obj.boxes[:, 3:])
    assert list(library.labels[: len(obj.parts)]) == [p.label for p in obj.parts]


def test_of_whole_objects_the_one_whose_picture_was_shown_is_found(tmp_path):
    """Features are the pictures themselves: what is tested is the index, and which record a view
    belongs to."""
    grid, size = GridConfig(16, 2, max_parts=16), 32
    prepare_procedural(
        tmp_path, 3, grid=grid, views=2, image_size=size, processes=1, progress=False
    )

    class Pictures:
        config = Config(
            model=ModelConfig(grid=grid, image_encoder=ImageEncoderConfig(image_size=size))
        )

        def encode_images(self, images):
            tokens = images.reshape(len(images), size, -1) - 0.5
            return Condition(tokens, np.zeros((len(images), 4, 4, 4, 1)))

    pipeline: Any = Pictures()
    retrieve, source = make_retrieval(pipeline, tmp_path), RecordSource(tmp_path)
    table = load_image_table(tmp_path, Pictures.config.model, "")
    for k in range(3):
        boxes = object_of_record(source[k]).boxes
        for view in table.images[k]:
            assert np.array_equal(retrieve(view / np.float32(255)).boxes, boxes)
