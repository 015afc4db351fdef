"""One CPU ray caster for training images, previews and PSNR: embree for the rays, numpy for the
light.

Deterministic, without system libraries. Colours are averaged in linear RGB and encoded to sRGB at
the end. The light is a key light in the x-z plane (from the front and above) with soft shadows, and
a sky, brighter from above, with ambient occlusion. Light, sub-pixel samples and the directions of
secondary rays are all symmetric in y, so that the picture of a mirrored object (y -> -y) taken from
the mirrored azimuth is the flipped picture: training mirrors pictures instead of rendering them
again.

Image frame: x right, y down; camera frame: x right, y down, z forward (OpenCV).
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from uniart_jax.objects.appearance import linear_to_srgb, sample_color, srgb_to_linear
from uniart_jax.objects.object import ArticulatedObject

UNIT_BOX = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])

KEY_DIRECTION = np.array([-0.62, 0.0, 0.78])  # towards the light
KEY_RADIUS = 0.12  # of the light's disc at distance 1: how soft its shadows are
KEY_STRENGTH = 0.62
SKY_STRENGTH = 0.42  # light from the horizon on a surface that sees all of it
SKY_GRADIENT = 0.14  # more on surfaces that look up, less on those that look down
SKY_FLOOR = 0.3  # share of the sky's light that reaches the deepest corner, in place of bounces
SKY_RAYS = 4  # secondary rays a sample
RAY_OFFSET = 2e-4  # of secondary rays from the surface they leave

# Okabe-Ito and friends: told apart by colour-blind eyes; part k has colour k modulo their number.
PART_COLORS = np.array(
    [
        [0.55, 0.60, 0.66], [0.90, 0.62, 0.00], [0.34, 0.71, 0.91], [0.00, 0.62, 0.45],
        [0.80, 0.47, 0.65], [0.94, 0.89, 0.26], [0.84, 0.37, 0.00], [0.00, 0.45, 0.70],
        [0.60, 0.40, 0.80], [0.45, 0.75, 0.30], [0.75, 0.55, 0.40], [0.95, 0.60, 0.60],
    ]
)  # fmt: skip


Scene = tuple[EmbreeScene, np.ndarray, np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Camera:
    """A pinhole that looks at the origin, z up, square frame.

    Attributes:
      azimuth: radians about +z; 0 looks at the front (camera on the -x side), pi/2 stands on the -y
        side.
      elevation: radians above the x-y plane, within (-pi/2, pi/2).
      fov_degrees: full angle of view, in degrees as every camera maker gives it.
      distance: from the origin, object units.

    Raises:
      ValueError: a value that makes no camera.
    """

    azimuth: float = 0.0
    elevation: float = 0.0
    fov_degrees: float = 35.0
    distance: float = 2.5

    def __post_init__(self):
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, float(getattr(self, field.name)))
        if not np.isfinite(dataclasses.astuple(self)).all():
            raise ValueError(f"camera: {self} is not finite")
        if not 0 < self.fov_degrees < 180:
            raise ValueError(
                f"camera: a field of view of {self.fov_degrees} degrees; give 0 < fov < 180"
            )
        if self.distance <= 0:
            raise ValueError(f"camera: a distance of {self.distance}; give one above 0")
        if abs(self.elevation) >= np.pi / 2 - 1e-6:
            raise ValueError(
                f"camera: an elevation of {self.elevation}; stay within +-pi/2 radians"
            )

    @property
    def position(self) -> np.ndarray:
        """[3] of the pinhole, object units."""
        return -self.distance * self._axes()[2]

    def _axes(self) -> np.ndarray:
        """[3, 3] rows: right, down, forward in the object frame."""
        ca, sa = np.cos(self.azimuth), np.sin(self.azimuth)
        ce, se = np.cos(self.elevation), np.sin(self.elevation)
        forward = np.array([ca * ce, sa * ce, -se])
        right = np.array([sa, -ca, 0.0])
        return np.stack([right, np.cross(forward, right), forward])

    def matrix(self) -> np.ndarray:
        """[4, 4] world -> camera."""
        matrix = np.eye(4)
        matrix[:3, :3] = self._axes()
        matrix[2, 3] = self.distance
        return matrix

    def project(self, points: np.ndarray, size: int) -> np.ndarray:
        """[..., 2] pixel coordinates (x right, y down; pixel (0, 0) spans [0, 1]) of [..., 3]
        points; NaN behind the pinhole."""
        seen = np.asarray(points) @ self._axes().T + [0, 0, self.distance]
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        return size / 2 * (1 + seen[..., :2] / (depth * self._tangent))

    def rays(
        self,
        size: int,
        offset: tuple[float, float] = (0.5, 0.5),
        window: tuple[int, int, int, int] | None = None,
    ) -> np.ndarray:
        """[rows, columns, 3] float32 unit directions in the object frame, through the point
        ``offset`` (x, y) of each pixel of a ``window``: first row, row after the last, first
        column, column after the last; None is the whole frame."""
        top, bottom, left, right = window or (0, size, 0, size)
        x = (2 * (np.arange(left, right) + offset[0]) / size - 1) * self._tangent
        y = (2 * (np.arange(top, bottom) + offset[1]) / size - 1) * self._tangent
        length = np.sqrt(1 + (x * x)[None, :] + (y * y)[:, None])
        right_axis, down, forward = self._axes()
        rays = np.empty((*length.shape, 3), np.float32)
        for c in range(3):
            plane = x[None, :] * right_axis[c] + (y * down[c] + forward[c])[:, None]
            np.divide(plane, length, out=rays[..., c], casting="same_kind")
        return rays

    def window(self, bounds: np.ndarray, size: int) -> tuple[int, int, int, int]:
        """The pixels that may see a box [2, 3], as ``rays`` takes them; all where the pinhole is
        not in front of the whole box."""
        corners = self.project(np.array(list(itertools.product(*bounds.T))), size)
        if not np.isfinite(corners).all():
            return 0, size, 0, size
        low = np.clip(np.floor(corners.min(0)) - 1, 0, size).astype(int)
        high = np.clip(np.ceil(corners.max(0)) + 1, 0, size).astype(int)
        return int(low[1]), int(high[1]), int(low[0]), int(high[0])

    @property
    def _tangent(self) -> float:
        return float(np.tan(np.deg2rad(self.fov_degrees) / 2))


def fit(target: ArticulatedObject | np.ndarray, camera: Camera, margin: float = 1.1) -> Camera:
    """The camera at the distance at which a box just fits the frame.

    Args:
      target: an object (its box at the shown state) or a box's two corners [2, 3].
      camera: direction and field of view; its distance is ignored.
      margin: frame over box, 1 = touching.
    """
    bounds = target.bounds if isinstance(target, ArticulatedObject) else np.asarray(target)
    corners = np.array(list(itertools.product(*bounds.T)))
    seen = corners @ camera._axes().T
    reach = np.abs(seen[:, :2]).max(1) * margin / camera._tangent - seen[:, 2]
    nearest = seen[:, 2].min()
    return dataclasses.replace(camera, distance=max(float(reach.max()), 1e-3 - nearest))


FRONT_LEFT = Camera(azimuth=np.deg2rad(-32), elevation=np.deg2rad(20), fov_degrees=30)


def sample_camera(rng: np.random.Generator, bounds: np.ndarray = UNIT_BOX) -> Camera:
    """A random front view: azimuth within +-50 degrees, elevation 5 to 40, field of view 25 to 45,
    margin 1.05 to 1.35 about ``bounds``."""
    camera = Camera(
        azimuth=np.deg2rad(rng.uniform(-50, 50)),
        elevation=np.deg2rad(rng.uniform(5, 40)),
        fov_degrees=rng.uniform(25, 45),
    )
    return fit(bounds, camera, margin=rng.uniform(1.05, 1.35))


def orbit_cameras(count: int) -> list[Camera]:
    """Cameras all around, evenly over the sphere (Fibonacci), that see the unit ball: 40 degrees of
    view at distance 2, as TRELLIS takes its feature views."""
    index = np.arange(count) + 0.5
    elevation = np.arcsin(1 - 2 * index / count)
    azimuth = (np.pi * (1 + 5**0.5) * index + np.pi) % (2 * np.pi) - np.pi
    return [Camera(a, e, 40.0, 2.0) for a, e in zip(azimuth, elevation, strict=True)]


def render(
    obj: ArticulatedObject,
    camera: Camera,
    size: int = 256,
    q: np.ndarray | dict[str, float] | None = None,
    samples: int = 4,
    part_colors: bool = False,
    scene: Scene | None = None,
) -> np.ndarray:
    """A picture of the object at state ``q``.

    Args:
      obj: any articulated object; both sides of every triangle are seen.
      camera: where from.
      size: pixels a side.
      q: joint coordinates as ``ArticulatedObject.coordinates`` takes them; None is the shown state.
      samples: a pixel, a square number: 1, 4, 9, ...
      part_colors: paint every part in one colour of its own instead of its appearance.
      scene: ``build_scene(obj, q)``, where many pictures are taken of one state.

    Returns:
      [size, size, 4] float32 sRGB and straight alpha, in [0, 1]; where alpha is 0 the colour is 0.
    """
    side = round(samples**0.5)
    if side < 1 or side * side != samples:
        raise ValueError(f"render: {samples} samples a pixel; give a square number (1, 4, 9, 16)")
    embree, triangles, face_part, first_face = scene or build_scene(obj, q)
    origin = camera.position.astype(np.float32)
    window = camera.window(_bounds(triangles), size)
    top, bottom, left, right = window
    shape = (bottom - top, right - left)
    hits, lights = [], []
    for row, column in itertools.product(range(side), range(side)):
        offset = ((column + 0.5) / side, (row + 0.5) / side)
        rays = camera.rays(size, offset, window).reshape(-1, 3)
        found = embree.run(np.broadcast_to(origin, rays.shape).copy(), rays, output=1)
        pixel = np.flatnonzero(found["primID"] >= 0)
        face = found["primID"][pixel]
        weight = np.stack([found["u"][pixel], found["v"][pixel]], -1)
        hits.append((pixel, face, weight))
        corner = triangles[face]
        point = corner[:, 0] + weight[:, :1] * corner[:, 1] + weight[:, 1:] * corner[:, 2]
        normal = corner[:, 3]  # a copy (fancy indexing), so it may be turned in place
        away = np.einsum("nc,nc->n", normal, rays[pixel]) > 0
        normal *= np.where(away, np.float32(-1), np.float32(1))[:, None]
        lights.append(_light(embree, point, normal, row, column, side))
    pixel = np.concatenate([h[0] for h in hits])
    face = np.concatenate([h[1] for h in hits])
    weight = np.concatenate([h[2] for h in hits])
    light = np.concatenate(lights)
    color = np.empty((len(face), 3), np.float32)
    part = face_part[face]
    for k in np.unique(part):
        mine = part == k
        if part_colors:
            color[mine] = srgb_to_linear(PART_COLORS[k % len(PART_COLORS)])
        else:
            u, v = weight[mine].T
            barycentric = np.stack([1 - u - v, u, v], -1)
            color[mine] = sample_color(obj.parts[k].mesh, face[mine] - first_face[k], barycentric)
    color *= light[:, None]
    pixels = shape[0] * shape[1]
    count = np.bincount(pixel, minlength=pixels)
    total = [np.bincount(pixel, color[:, c], minlength=pixels) for c in range(3)]
    hit = np.flatnonzero(count)
    seen = np.zeros((pixels, 4), np.float32)
    seen[hit, :3] = linear_to_srgb(np.stack(total, -1)[hit] / count[hit, None])
    seen[:, 3] = count / samples
    image = np.zeros((size, size, 4), np.float32)
    image[top:bottom, left:right] = seen.reshape(*shape, 4)
    return image


def part_pixels(obj: ArticulatedObject, camera: Camera, size: int = 256) -> np.ndarray:
    """[K] int, pixels of a picture of ``size`` at the shown state whose centre shows each part; 0 =
    hidden or outside of the picture."""
    embree, triangles, face_part, _ = build_scene(obj)
    window = camera.window(_bounds(triangles), size)
    rays = camera.rays(size, window=window).reshape(-1, 3)
    origin = np.broadcast_to(camera.position.astype(np.float32), rays.shape).copy()
    face = embree.run(origin, rays, output=1)["primID"]
    return np.bincount(face_part[face[face >= 0]], minlength=len(obj.parts))


def _bounds(triangles: np.ndarray) -> np.ndarray:
    """[2, 3] box of triangles [F, 4, 3] as ``build_scene`` gives them."""
    first, ends = triangles[:, 0], triangles[:, :1] + triangles[:, 1:3]
    low = np.minimum(first.min(0), ends.min((0, 1)))
    return np.stack([low, np.maximum(first.max(0), ends.max((0, 1)))])


def build_scene(obj: ArticulatedObject, q: np.ndarray | dict[str, float] | None = None) -> Scene:
    """Embree scene of all parts at state q; [F, 4, 3] corner, two edges and unit normal of each
    triangle; [F] part; [K] first face."""
    corners, part, first = [], [], []
    for k, (p, matrix) in enumerate(zip(obj.parts, obj.forward_kinematics(q), strict=True)):
        vertices = p.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        first.append(sum(len(c) for c in corners))
        corners.append(vertices[p.mesh.faces])
        part.append(np.full(len(p.mesh.faces), k))
    corner = np.concatenate(corners)
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, corner.astype(np.float32))
    edges = corner[:, 1:] - corner[:, :1]
    normal = np.cross(edges[:, 0], edges[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    triangles = np.concatenate([corner[:, :1], edges, normal[:, None]], 1).astype(np.float32)
    return scene, triangles, np.concatenate(part), np.array(first)


def _light(scene: EmbreeScene, point, normal, row: int, column: int, side: int) -> np.ndarray:
    """[n] light that leaves a white surface at [n, 3] points, as seen by one sub-pixel sample."""
    start = (point + RAY_OFFSET * normal).astype(np.float32)
    key = _key_direction(row, column, side)
    facing = normal @ key
    lit = np.flatnonzero(facing > 0)
    if len(lit):
        blocked = occluded(scene, start[lit], np.broadcast_to(key, (len(lit), 3)))
        facing[lit[blocked]] = 0
    seen = np.zeros(len(point), np.float32)
    total = np.zeros(len(point), np.float32)
    for direction in _sky_directions(row, column, side):
        cosine = normal @ direction
        towards = np.where(cosine < 0, np.float32(-1), np.float32(1))[:, None] * direction
        free = ~occluded(scene, start, towards)
        total += np.abs(cosine)
        seen += np.abs(cosine) * free
    openness = SKY_FLOOR + (1 - SKY_FLOOR) * seen / np.maximum(total, 1e-6)
    sky = (SKY_STRENGTH + SKY_GRADIENT * normal[:, 2]) * openness
    return sky + KEY_STRENGTH * np.maximum(facing, 0)


def light_on(
    scene: EmbreeScene, points: np.ndarray, normals: np.ndarray, samples: int = 4
) -> np.ndarray:
    """[n] float32 light on places [n, 3] with unit normals [n, 3], a little above the surfaces that
    cast shadows: what a white one would send to a camera of ``render``; ``samples`` as there."""
    side = round(samples**0.5)
    places, normals = points.astype(np.float32), normals.astype(np.float32)
    light = np.zeros(len(places), np.float32)
    for row, column in itertools.product(range(side), range(side)):
        light += _light(scene, places, normals, row, column, side)
    return light / side**2


def occluded(scene: EmbreeScene, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """[n] whether something lies in a direction [n, 3] from places [n, 3] float32."""
    rays = np.ascontiguousarray(direction, dtype=np.float32)
    return scene.run(start, rays, query="OCCLUDED") == 0


def _key_direction(row: int, column: int, side: int) -> np.ndarray:
    """[3] float32 unit direction to the point of the light's disc that a sub-pixel sample looks at.

    The sample mirrored left-right looks at the mirrored point: image x runs against world y.
    """
    key = KEY_DIRECTION / np.linalg.norm(KEY_DIRECTION)
    across = np.array([0.0, 1.0, 0.0])
    along = np.cross(key, across)
    x, y = (2 * (np.array([column, row]) + 0.5) / side - 1) * KEY_RADIUS
    direction = key - x * across + y * along
    return (direction / np.linalg.norm(direction)).astype(np.float32)


def _sky_directions(row: int, column: int, side: int) -> np.ndarray:
    """[SKY_RAYS, 3] float32 unit directions (each stands for its opposite too) of a sub-pixel
    sample, mirrored like the samples."""
    mirrored = side - 1 - column
    if column > mirrored:
        return _sky_directions(row, mirrored, side) * np.array([1, -1, 1], np.float32)
    count = SKY_RAYS * side * ((side + 1) // 2)
    index = (np.arange(SKY_RAYS) * side + row) * ((side + 1) // 2) + column + 0.5
    height = index / count  # a Fibonacci hemisphere, dealt out over the samples of the left half
    angle = np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    if column == mirrored:  # the middle column mirrors itself: pairs
        directions[1::2] = directions[: SKY_RAYS // 2 * 2 : 2] * [1, -1, 1]
    return directions.astype(np.float32)
