import numpy as np
import pytest
import trimesh
from PIL import Image

from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.visual.render import UNIT_BOX, Camera, fit, part_pixels, render, sample_camera

RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def block(low, high, color):
    mesh = trimesh.creation.box(bounds=[low, high])
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=np.tile([*color, 255], (12, 1)))
    return mesh


def one(mesh):
    return ArticulatedObject((Part("it", mesh),))


def lopsided():
    """No symmetry at all: a box, a ball to one side, a flap that hangs over."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.14)
    ball.apply_translation([-0.2, 0.3, 0.3])
    ball.visual = trimesh.visual.ColorVisuals(
        ball, vertex_colors=np.tile([40, 90, 200, 255], (len(ball.vertices), 1))
    )
    flap = block([-0.5, -0.4, 0.3], [0.0, 0.1, 0.34], (200, 150, 40))
    return ArticulatedObject(
        (
            Part("base", block([-0.3, -0.4, -0.5], [0.3, 0.5, 0.1], (160, 60, 60))),
            Part("ball", ball, 0, Joint([0, 0, 0.3], [0, 0, 1], angle=(0, 1.5))),
            Part("flap", flap, 0, Joint([0, 0, 0], [0, 0, 1], travel=(-0.2, 0))),
        )
    )


def test_camera_stands_where_its_angles_say():
    np.testing.assert_allclose(Camera(0, 0, 35, 2).position, [-2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(Camera(np.pi / 2, 0, 35, 2).position, [0, -2, 0], atol=1e-12)
    np.testing.assert_allclose(Camera(0, np.pi / 6, 35, 2).position, [-(3**0.5), 0, 1], atol=1e-12)


def test_matrix_is_a_rigid_motion_that_puts_the_pinhole_at_zero():
    camera = Camera(0.7, 0.4, 40, 3)
    matrix = camera.matrix()
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(matrix @ [*camera.position, 1], [0, 0, 0, 1], atol=1e-12)


def test_project_and_rays_agree():
    camera = Camera(-0.6, 0.3, 30, 2.4)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (50, 3))
    pixels = camera.project(points, 64)
    towards = points - camera.position
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    for (x, y), direction in zip(pixels, towards, strict=True):
        offset = (x % 1, y % 1)
        np.testing.assert_allclose(camera.rays(64, offset)[int(y), int(x)], direction, atol=1e-5)
    assert camera.project(np.array([0, 0, 0.4]), 64)[1] < 32  # up is up
    assert Camera().project(np.array([0, 0.4, 0]), 64)[0] < 32  # +y is at the left of a front view
    assert np.isnan(camera.project(2 * camera.position, 64)).all()


@pytest.mark.parametrize(
    "bad", [{"distance": 0}, {"fov_degrees": 180}, {"elevation": 1.6}, {"azimuth": np.nan}]
)
def test_a_camera_that_is_none_is_refused(bad):
    with pytest.raises(ValueError, match="camera"):
        Camera(**bad)


def test_front_of_a_red_cube_is_where_geometry_says():
    camera, size = Camera(0, 0, 35, 2.5), 64
    image = render(one(block(*UNIT_BOX, RED)), camera, size)
    assert image.shape == (size, size, 4) and image.dtype == np.float32
    half = size / 2 * 0.5 / (2.0 * np.tan(np.deg2rad(17.5)))  # the front face is 2 away
    grid = np.abs(np.arange(size) + 0.5 - size / 2)
    inside = (grid[:, None] < half - 1) & (grid[None] < half - 1)
    outside = (grid[:, None] > half + 1) | (grid[None] > half + 1)
    assert (image[inside, 3] == 1).all() and (image[outside] == 0).all()
    assert image[..., 3].sum() == pytest.approx((2 * half) ** 2, rel=0.02)
    assert (image[inside, 0] > 0.6).all() and (image[inside, 1:3] == 0).all()


def test_colors_are_averaged_in_linear_light():
    # A face whose left half is black and right half white, its seam through the middle of a pixel
    # column.
    left, right = (
        block([-0.5, 0, -0.5], [0.5, 0.5, 0.5], (0, 0, 0)),
        block([-0.5, -0.5, -0.5], [0.5, 0, 0.5], WHITE),
    )
    image = render(one(trimesh.util.concatenate([left, right])), Camera(0, 0, 35, 2.5), 65)
    row = image[32, :, 0]
    bright = row[40].astype(np.float64)
    linear = ((bright + 0.055) / 1.055) ** 2.4
    assert row[32] == pytest.approx(linear_to_srgb(linear / 2), abs=0.02)


def test_edges_have_straight_alpha():
    image = render(one(block(*UNIT_BOX, WHITE)), Camera(0, 0, 35, 2.5), 65, samples=16)
    edge = (image[..., 3] > 0) & (image[..., 3] < 1)
    assert edge.any()
    np.testing.assert_allclose(image[edge, :3], image[32, 32, 0], atol=0.06)


@pytest.mark.parametrize("samples", [1, 4, 9])
def test_mirrored_object_from_the_mirrored_side_is_the_flipped_picture(samples):
    obj = lopsided()
    camera = fit(obj, Camera(0.5, 0.4, 35))
    mirrored = obj.transformed(np.diag([1, -1, 1, 1]).astype(float))
    image = render(obj, camera, 48, q={"ball": 0.8, "flap": -0.1}, samples=samples)
    other = render(
        mirrored, Camera(-camera.azimuth, camera.elevation, 35, camera.distance), 48,
        q=_same_motion(obj, mirrored, {"ball": 0.8, "flap": -0.1}), samples=samples,
    )  # fmt: skip
    difference = np.abs(image - other[:, ::-1])
    assert np.abs(image - image[:, ::-1]).mean() > 0.02  # the object itself has no symmetry
    assert difference.mean() < 1e-3
    assert (difference.max(-1) > 0.02).mean() < 2e-3


def _same_motion(obj, mirrored, q):
    """Coordinates that bring the mirrored object to the mirrored state, whichever way its limits
    now run."""
    out = {}
    for name, value in q.items():
        before, after = obj.parts[obj.index(name)].joint, mirrored.parts[obj.index(name)].joint
        out[name] = value if np.allclose(before.limits, after.limits) else -value
    return out


def test_texture_is_the_right_way_up():
    # A square in the plane x = 0, seen from the front (-x): +y is left, +z is up. v runs up, images
    # run down.
    corners = [[0, 0.5, -0.5], [0, -0.5, -0.5], [0, -0.5, 0.5], [0, 0.5, 0.5]]
    image = np.array([[RED, GREEN], [BLUE, WHITE]], np.uint8).repeat(32, 0).repeat(32, 1)
    visual = trimesh.visual.TextureVisuals(
        uv=[[0, 0], [1, 0], [1, 1], [0, 1]],
        material=trimesh.visual.material.SimpleMaterial(image=Image.fromarray(image)),
    )
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    seen = render(one(mesh), Camera(0, 0, 35, 2.5), 64)
    hue = lambda y, x: tuple((seen[y, x, :3] > 0.3).astype(int) * 255)  # noqa: E731
    assert (hue(20, 20), hue(20, 44), hue(44, 20), hue(44, 44)) == (RED, GREEN, BLUE, WHITE)


def test_state_moves_parts():
    obj = lopsided()
    camera = fit(obj, Camera(0, 0.2, 35), 1.3)
    assert np.abs(render(obj, camera, 32) - render(obj, camera, 32, q={"flap": -0.2})).max() > 0.2


def test_part_colors_replace_the_appearance():
    obj = ArticulatedObject(
        (
            Part("a", block([-0.5, 0, -0.5], [0.5, 0.5, 0.5], WHITE)),
            Part("b", block([-0.5, -0.5, -0.5], [0.5, 0, 0.5], WHITE), 0),
        )
    )
    image = render(obj, Camera(0, 0, 35, 2.5), 32, part_colors=True)
    assert np.abs(image[16, 10, :3] - image[16, 22, :3]).max() > 0.2


def test_pixels_of_a_part_behind_another_are_none():
    wall = Part("base", block([-0.05, -0.5, -0.5], [0.05, 0.5, 0.5], RED))
    behind = Part("back", block([0.2, -0.1, -0.1], [0.3, 0.1, 0.1], GREEN), 0, wall.joint)
    obj = ArticulatedObject((wall, behind))
    front, back = (part_pixels(obj, Camera(azimuth=a), 64) for a in (0.0, np.pi))
    assert front[0] > 100 and front[1] == 0
    assert back[0] > 100 and back[1] > 10


def test_corners_and_undersides_are_darker():
    floor, wall = (
        block([-0.5, -0.5, -0.5], [0.5, 0.5, -0.45], WHITE),
        block([0.4, -0.5, -0.45], [0.5, 0.5, 0.5], WHITE),
    )
    roof = block([-0.3, -0.5, 0.3], [0.4, 0.5, 0.35], WHITE)
    image = render(
        one(trimesh.util.concatenate([floor, wall, roof])), Camera(0, 0.5, 35, 2.6), 96, samples=9
    )

    def brightness(point):
        x, y = Camera(0, 0.5, 35, 2.6).project(np.array(point), 96)
        return image[int(y), int(x), 0]

    assert brightness([-0.45, 0, -0.45]) > brightness([0.35, 0, -0.45]) + 0.1


def test_both_sides_of_a_sheet_are_seen_and_lit():
    sheet = trimesh.Trimesh([[0, 0.5, -0.5], [0, -0.5, -0.5], [0, 0, 0.5]], [[0, 1, 2]])
    flipped = trimesh.Trimesh(sheet.vertices, [[0, 2, 1]])
    camera = Camera(0, 0, 35, 2.5)
    np.testing.assert_array_equal(render(one(sheet), camera, 32), render(one(flipped), camera, 32))


def test_same_input_same_picture():
    camera = sample_camera(np.random.default_rng(3))
    np.testing.assert_array_equal(render(lopsided(), camera, 40), render(lopsided(), camera, 40))


def test_samples_must_be_a_square():
    with pytest.raises(ValueError, match="square number"):
        render(lopsided(), Camera(), 8, samples=3)


@pytest.mark.parametrize("margin", [1.0, 1.3])
def test_fit_leaves_the_margin(margin):
    bounds = np.array([[-0.5, -0.2, -0.1], [0.5, 0.2, 0.1]])
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    for azimuth in (0, 0.8, -2.5):
        camera = fit(bounds, Camera(azimuth, 0.4, 40), margin)
        reach = np.abs(camera.project(corners, 2) - 1).max()
        assert reach == pytest.approx(1 / margin)


def test_sampled_cameras_look_at_the_front_and_hold_the_object():
    rng = np.random.default_rng(0)
    bounds = np.array([[-0.2, -0.5, -0.3], [0.2, 0.5, 0.3]])
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    for _ in range(100):
        camera = sample_camera(rng, bounds)
        assert abs(np.rad2deg(camera.azimuth)) <= 50 and 5 <= np.rad2deg(camera.elevation) <= 40
        assert 25 <= camera.fov_degrees <= 45
        assert 1 / 1.36 < np.abs(camera.project(corners, 2) - 1).max() < 1 / 1.04


@pytest.mark.parametrize(
    ("extents", "part_of_frame"), [((0.3, 0.2, 0.6), True), ((3, 3, 3), False)]
)
@pytest.mark.parametrize("samples", [1, 4])
def test_rays_only_where_the_object_is_give_the_whole_picture(
    monkeypatch, samples, extents, part_of_frame
):
    """Off to a side, and around the pinhole."""
    box = trimesh.creation.box(extents)
    box.apply_translation([-0.2, 0.25, 0.1])
    obj = ArticulatedObject((Part("box", box, -1, Joint.fixed()),))
    camera = Camera(0.4, 0.3, 50.0, 1.2)
    assert (camera.window(box.bounds, 64) != (0, 64, 0, 64)) == part_of_frame
    windowed = render(obj, camera, 64, samples=samples)
    assert windowed[..., 3].any()
    monkeypatch.setattr(Camera, "window", lambda self, bounds, size: (0, size, 0, size))
    np.testing.assert_array_equal(windowed, render(obj, camera, 64, samples=samples))


def test_an_object_outside_the_frame_gives_an_empty_picture():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.apply_translation([0, 5, 0])
    picture = render(ArticulatedObject((Part("box", box, -1, Joint.fixed()),)), Camera(), 32)
    assert picture.shape == (32, 32, 4) and not picture.any()


def test_window_of_rays_is_that_part_of_all():
    camera = Camera(0.4, 0.3, 50.0, 2.0)
    whole = camera.rays(16, (0.25, 0.75))
    part = camera.rays(16, (0.25, 0.75), (2, 9, 5, 6))
    np.testing.assert_array_equal(part, whole[2:9, 5:6])
    np.testing.assert_allclose(np.linalg.norm(whole, axis=-1), 1, rtol=1e-6)
