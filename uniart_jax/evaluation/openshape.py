"""OpenShape similarity, the paper's figure of whether a shape is what the image shows: cosine of a
point cloud's and an image's embedding.

    RS  the predicted object at rest against the image      AS  mean over ``STATES``, always against that one image

Networks: ``models.openshape`` (openshape-pointbert-vitg14-rgb) and ``models.openclip``
(ViT-bigG-14, laion2b_s39b_b160k), whose weights are no part of this package: without them nothing
is computed (``NOT_COMPUTED``). Everything that the paper leaves open:

- Cloud: 10,000 points uniform over the surfaces of all parts, inner ones too, in random order with
  a fixed seed; the same points of the parts in every state. Centred at their mean, the farthest at
  distance 1. Colours are sRGB; an object without any gets OpenShape's .4.
- Frame: gravity along -z, and mirrored in y: OpenShape swaps y and z of files whose y is up, which
  makes mirror images, and has seen no others.
- Image: the one that the prediction was made from where the caller has it, else the reference at
  rest, rendered from the front left and above. What is transparent is black. Then OpenCLIP's own
  preparation: bicubic to 224 pixels on the shorter side, the middle square.
- One draw of points: OpenShape's authors report cosines of .94 to .99 between two draws' embeddings
  of one object, so differences of a hundredth in one object mean nothing.

One image costs the tower about a trillion floating-point operations, half a minute on two CPU
cores, five clouds some seconds: there is one image an object, kept while that object's samples are
measured.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image

from uniart_jax.evaluation.materials import uncolored
from uniart_jax.evaluation.metric import STATES, Figures, Metric
from uniart_jax.models import openclip, openshape
from uniart_jax.models.openclip import Params
from uniart_jax.objects.appearance import linear_to_srgb, sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import Camera, fit, render
from uniart_jax.weights.openshape import OpenShapeConfig, read_encoders

NOT_COMPUTED = "not computed: no OpenShape weights (uniart convert openshape FOLDER --out WEIGHTS)"
POINTS = 10_000
NO_COLOR = 0.4  # sRGB that OpenShape was trained with where a cloud has no colours
VIEW = Camera(azimuth=np.deg2rad(-32), elevation=np.deg2rad(20), fov_degrees=30)
RENDER_SIZE = 448  # pixels a side: twice what the tower sees

METRICS: dict[str, Metric] = {
    "rs_openshape": Metric(
        "RS OpenShape",
        "higher",
        -1.0,
        "cosine of OpenShape's embedding of the object at rest and OpenCLIP's of the image",
    ),
    "as_openshape": Metric(
        "AS OpenShape", "higher", -1.0, "as RS OpenShape, mean over five states, one image"
    ),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Encoders:
    """Both networks' parameters: the point encoder's in memory, the image tower's a memory map.
    Equal to itself alone."""

    config: OpenShapeConfig
    points: Params
    image: Params


@functools.lru_cache(maxsize=1)
def load(path: str | Path) -> Encoders:
    """The encoders in a folder of ``uniart convert openshape``.

    Raises:
      FileNotFoundError: no such folder, or a file is missing.
      ValueError: a file is damaged or of another size.
    """
    config, points, image = read_encoders(Path(path))
    return Encoders(config, jax.tree.map(jnp.asarray, points), image)


def measure(
    pred: ArticulatedObject,
    ref: ArticulatedObject,
    weights: str | Path | Encoders | None = None,
    image: np.ndarray | None = None,
) -> Figures:
    """``METRICS`` of a prediction; empty without weights, since nothing can be said then.

    Args:
      pred, ref: from ``metric.at_rest``; ``ref`` only lends its picture where ``image`` is None.
      weights: a folder for ``load``, or what it returned.
      image: [H, W, 3 or 4] uint8 sRGB, what the prediction was made from.

    Raises:
      FileNotFoundError, ValueError: of ``load``; or the prediction has no surface.
    """
    if weights is None:
        return {}
    encoders = weights if isinstance(weights, Encoders) else load(weights)
    picture = reference_picture(ref) if image is None else np.ascontiguousarray(image)
    seen = _embed_kept(encoders, picture.tobytes(), picture.shape)
    cosines = embed_clouds(encoders, point_clouds(pred)) @ seen
    return {"rs_openshape": float(cosines[0]), "as_openshape": float(cosines.mean())}


def point_clouds(obj: ArticulatedObject, number: int = POINTS, seed: int = 0) -> np.ndarray:
    """The object in each of ``STATES`` as OpenShape wants it.

    Returns:
      [len(STATES), number, 6] float32: x, y, z in the unit ball, sRGB in [0, 1].

    Raises:
      ValueError: the object's surface has no area.
    """
    areas = np.concatenate([part.mesh.area_faces for part in obj.parts])
    if not areas.sum() > 0:
        raise ValueError(f"object '{obj.name}': its surface has no area")
    first = np.cumsum([0, *(len(part.mesh.faces) for part in obj.parts)])
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(areas), number, p=areas / areas.sum())
    across, along = np.sqrt(rng.random(number)), rng.random(number)
    weight = np.stack([1 - across, across * (1 - along), across * along], -1)
    owner = np.searchsorted(first, chosen, side="right") - 1
    places = np.empty((number, 3))
    colors = np.full((number, 3), NO_COLOR, np.float32)
    plain = uncolored(obj)
    for k in np.unique(owner):
        mesh, mine = obj.parts[k].mesh, owner == k
        faces = chosen[mine] - first[k]
        places[mine] = np.einsum("nk,nkc->nc", weight[mine], mesh.triangles[faces])
        if not plain:
            colors[mine] = linear_to_srgb(sample_color(mesh, faces, weight[mine]))
    clouds = np.empty((len(STATES), number, 6), np.float32)
    clouds[..., 3:] = colors
    for cloud, state in zip(clouds, STATES, strict=True):
        moved = obj.forward_kinematics(obj.open(state))[owner]
        cloud[:, :3] = unit_ball(
            np.einsum("nij,nj->ni", moved[:, :3, :3], places) + moved[:, :3, 3]
        )
    return clouds


def unit_ball(points: np.ndarray) -> np.ndarray:
    """Points [N, 3] mirrored in y, centred at their mean, the farthest at distance 1."""
    centered = (points - points.mean(0)) * [1, -1, 1]
    return centered / np.linalg.norm(centered, axis=1).max()


def embed_clouds(encoders: Encoders, clouds: np.ndarray) -> np.ndarray:
    """[S, N, 6] -> [S, E] unit vectors."""
    found = _embed_points(encoders.points, clouds, encoders.config.point_encoder)
    return _unit(np.asarray(found))


def embed_picture(encoders: Encoders, picture: np.ndarray) -> np.ndarray:
    """[H, W, 3 or 4] uint8 sRGB -> [E] unit vector. Slow: the whole image tower."""
    config = encoders.config.image_tower
    image = prepare(picture, config.image_size)[None]
    return _unit(np.asarray(openclip.embed(encoders.image, jnp.asarray(image), config)))[0]


def prepare(picture: np.ndarray, size: int) -> np.ndarray:
    """OpenCLIP's preparation of a picture.

    Args:
      picture: [H, W, 3 or 4] uint8 sRGB; transparency becomes black.

    Returns:
      [size, size, 3] float32, normalised.
    """
    image = Image.fromarray(picture)
    if image.mode != "RGB":
        image = image.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", image.size, (0, 0, 0, 255)), image)
    width, height = (max(size, int(size * side / min(image.size))) for side in image.size)
    image = image.convert("RGB").resize((width, height), Image.Resampling.BICUBIC)
    left, top = round((width - size) / 2), round((height - size) / 2)
    values = np.asarray(image.crop((left, top, left + size, top + size)), np.float32) / 255
    mean, std = (np.asarray(v, np.float32) for v in (openclip.IMAGE_MEAN, openclip.IMAGE_STD))
    return (values - mean) / std


def reference_picture(ref: ArticulatedObject) -> np.ndarray:
    """[448, 448, 4] uint8 of an object at its shown state from the front left and above, the
    background transparent."""
    picture = render(ref, fit(ref, VIEW), RENDER_SIZE)
    return np.rint(picture * 255).astype(np.uint8)


_embed_points = jax.jit(openshape.embed, static_argnames="config")


@functools.lru_cache(maxsize=1)
def _embed_kept(encoders: Encoders, pixels: bytes, shape: tuple[int, ...]) -> np.ndarray:
    return embed_picture(encoders, np.frombuffer(pixels, np.uint8).reshape(shape))


def _unit(x: np.ndarray) -> np.ndarray:
    """[S, E] in float64, each of length 1."""
    x = x.astype(np.float64)
    return x / np.linalg.norm(x, axis=-1, keepdims=True)
