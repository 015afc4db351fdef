"""Back-to-back faces: the outer one is kept, solids are solid again, and nothing else is
touched."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import SimpleMaterial

from uniart_jax.objects.double_faces import POINTS, _spread, single_sided
from uniart_jax.objects.load import load_object
from uniart_jax.voxels.voxelize import voxelize

RED, BLUE = (200, 30, 30, 255), (30, 30, 200, 255)


def doubled(mesh: trimesh.Trimesh, seed: int = 0) -> trimesh.Trimesh:
    """Every face a second time, turned and with vertices of its own: outer faces red, inner ones
    blue; in any order, corners rolled."""
    rng = np.random.default_rng(seed)
    count = len(mesh.vertices)
    faces = np.concatenate([mesh.faces, count + mesh.faces[:, ::-1]])
    colors = np.repeat([RED, BLUE], len(mesh.faces), 0)
    order = rng.permutation(len(faces))
    rolled = np.stack([np.roll(f, rng.integers(3)) for f in faces[order]])
    vertices = np.concatenate([mesh.vertices, mesh.vertices])
    made = trimesh.Trimesh(vertices, rolled, process=False)
    made.visual = ColorVisuals(made, face_colors=colors[order])
    return made


def open_box() -> trimesh.Trimesh:
    """A box without its lid: a sheet that has an outside, as far as rays can tell."""
    box = trimesh.creation.box((1, 1, 1))
    box.update_faces(box.face_normals[:, 2] < 0.5)
    return box


def nested() -> trimesh.Trimesh:
    """A ball in a hollow box: the ball and the box's inner wall are never seen from outside."""
    inner = trimesh.creation.box((0.8, 0.8, 0.8))
    inner.invert()
    ball = trimesh.creation.icosphere(1, 0.2)
    return trimesh.util.concatenate([trimesh.creation.box((1, 1, 1)), inner, ball])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "shape",
    [
        trimesh.creation.box((1, 0.5, 0.02)),
        trimesh.creation.torus(0.5, 0.1, major_sections=12, minor_sections=8),
        trimesh.util.concatenate(
            [trimesh.creation.box((1, 1, 0.1)), trimesh.creation.box((0.1, 0.1, 0.1), trimesh.transformations.translation_matrix((0, 0, 0.3)))]  # noqa: E501
        ),
        open_box(),
    ],
    ids=["box", "torus", "two pieces", "open box"],
)  # fmt: skip
def test_the_outer_face_of_each_pair_is_kept(shape, seed):
    single, removed = single_sided(doubled(shape, seed))
    assert removed == len(single.faces) == len(shape.faces)
    assert (single.visual.face_colors == RED).all()
    np.testing.assert_allclose(single.area, shape.area)
    if shape.is_watertight:
        np.testing.assert_allclose(single.volume, shape.volume)


def test_what_nobody_sees_is_turned_by_its_volume():
    shape = nested()
    single, removed = single_sided(doubled(shape))
    assert removed == len(shape.faces)
    far = np.linalg.norm(single.triangles_center, axis=1)
    ball = far < 0.25
    outward = np.einsum("fc,fc->f", single.face_normals, single.triangles_center) > 0
    assert outward[ball].all()  # the ball is solid
    outer = np.abs(single.triangles_center).max(1) > 0.45
    assert outward[outer].all()


def test_it_is_the_same_every_time():
    mesh = doubled(nested(), 4)
    first, second = (single_sided(mesh)[0] for _ in range(2))
    np.testing.assert_array_equal(first.faces, second.faces)


def test_others_are_left_alone():
    box = trimesh.creation.box((1, 1, 1))
    assert single_sided(box) == (box, 0)
    beside = trimesh.util.concatenate([box, box.copy().apply_translation((1, 0, 0))])
    assert single_sided(beside) == (beside, 0)  # they share a face, back to back
    # one piece, too, once their corners are one
    joined = trimesh.Trimesh(beside.vertices, beside.faces, process=True)
    assert joined.body_count == 1 and single_sided(joined) == (joined, 0)
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    assert single_sided(sheet) == (sheet, 0)


def test_each_piece_is_judged_by_itself():
    """A doubled box beside a dense ball that is not; the ball's inside is turned out on purpose,
    and stays so."""
    ball = trimesh.creation.icosphere(4, 0.3).apply_translation((2, 0, 0))
    ball.invert()
    ball.visual = ColorVisuals(ball, face_colors=np.tile(BLUE, (len(ball.faces), 1)))
    single, removed = single_sided(
        trimesh.util.concatenate([doubled(trimesh.creation.box((1, 1, 1))), ball])
    )
    assert removed == 12 and len(single.faces) == 12 + len(ball.faces)
    box = single.triangles_center[:, 0] < 1
    assert (single.visual.face_colors[box] == RED).all()
    np.testing.assert_array_equal(single.triangles[~box], ball.triangles)


def test_faces_without_area_do_not_count():
    box = doubled(trimesh.creation.box((1, 1, 1)))
    flat = np.repeat(box.faces[:1, :1], 3, 1).repeat(100, 0)
    mesh = trimesh.Trimesh(box.vertices, np.concatenate([box.faces, flat]), process=False)
    sliver = np.concatenate([box.vertices, [[0.5, 0.5, z] for z in np.linspace(-0.5, 0.5, 52)]])
    corners = len(box.vertices) + np.arange(50)[:, None] + [0, 1, 2]
    thin = trimesh.Trimesh(sliver, np.concatenate([box.faces, corners]), process=False)
    for made, more in ((mesh, 100), (thin, 50)):
        single, removed = single_sided(made)
        assert removed == 12 and len(single.faces) == 12 + more


def test_no_patch_is_asked_more_often_than_it_should():
    points, faces = (
        np.asarray(x) for x in (lambda b: (b.vertices, b.faces))(trimesh.creation.icosphere(2))
    )
    for count in (63, 64, 65, 100, 127, 128, 200):
        asked = _spread(points, faces[:count], np.zeros(count, int))
        assert POINTS / 2 <= len(asked) <= POINTS


def test_a_texture_is_shared_not_copied():
    mesh = doubled(trimesh.creation.box((1, 1, 1)))
    picture = SimpleMaterial(image=Image.new("RGB", (4, 4)))
    mesh.visual = TextureVisuals(uv=mesh.vertices[:, :2], material=picture)
    single, removed = single_sided(mesh)
    assert removed == 12 and single.visual.material is picture


def test_repeated_faces_go_too():
    mesh = doubled(trimesh.creation.box((1, 1, 1)))
    twice = trimesh.util.concatenate([mesh, mesh])
    single, removed = single_sided(twice)
    assert len(single.faces) == 12 and removed == 36 and single.volume == pytest.approx(1)


def test_objects_are_read_so(tmp_path):
    mesh = doubled(trimesh.creation.box((1, 1, 1)))
    mesh.export(tmp_path / "box.ply")
    (tmp_path / "a.urdf").write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh '
        'filename="box.ply"/></geometry></visual></link></robot>'
    )
    obj = load_object(tmp_path)
    assert obj.parts[0].mesh.volume == pytest.approx(1)
    assert any("12 faces exist twice" in line for line in obj.provenance)
    grid = voxelize(obj.normalized(), 16, 2)
    assert grid.sdf.min() < -1.4  # inside is inside: a shell would end at -.87
