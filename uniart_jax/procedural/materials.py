"""Seeded materials: plausible colours, and small images for wood grain, planks, brushed metal and
stone.

A textured material is *projected* on its solid by one linear map from space to the image (``grain``
is the axis along which the streaks run). One map for all faces has no seams, so a textured mesh
stays closed vertex by vertex; ``shapes.Shape.mesh`` applies it. The projection is oblique, so no
axis-aligned face is seen edge-on by it.
"""

from __future__ import annotations

import colorsys
import dataclasses

import numpy as np
import trimesh
from PIL import Image

TEXTURE_SIZE = 64

# rows u, v of the projection; streaks of an image run along v
_PROJECTIONS = {
    "x": np.array([[0.0, 0.93, 0.37], [1.0, 0.29, 0.23]]),
    "y": np.array([[0.37, 0.0, 0.93], [0.29, 1.0, 0.23]]),
    "z": np.array([[0.37, 0.93, 0.0], [0.29, 0.23, 1.0]]),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Material:
    """A surface finish; compared by identity, since one object shares its materials between parts.

    Attributes:
      color: sRGB in [0, 1]; also what stands for the material where no image fits.
      image: [64, 64, 3] uint8 sRGB, or None for a plain colour.
      grain: axis along which the image's streaks run: 'x', 'y' or 'z'.
      tile: metres of the solid that the image covers.
    """

    color: tuple[float, float, float]
    image: np.ndarray | None = None
    grain: str = "z"
    tile: float = 1.0

    def along(self, grain: str) -> Material:
        """The same finish with its streaks along another axis (plain colours stay themselves)."""
        if self.image is None or grain == self.grain:
            return self
        return dataclasses.replace(self, grain=grain)

    def darker(self, factor: float) -> Material:
        """The plain colour of this finish times ``factor``: for plinths, grooves and insides."""
        r, g, b = np.clip(np.array(self.color) * factor, 0, 1)
        return Material((float(r), float(g), float(b)))

    def project(self, points: np.ndarray) -> np.ndarray:
        """[n, 2] coordinates in the image, within [0, 1], of ``points`` [n, 3] of one solid
        (metres)."""
        flat = points @ _PROJECTIONS[self.grain].T
        lo, extent = flat.min(0), np.ptp(flat, 0)
        covered = extent / np.maximum(self.tile, extent)
        shift = np.mod(flat.mean(0) * 7.31, 1.0) * (1 - covered)  # other pieces, other boards
        return shift + (flat - lo) / np.maximum(self.tile, extent)


def plain(rgb) -> Material:
    """A plain sRGB colour."""
    r, g, b = np.clip(np.asarray(rgb, dtype=np.float64), 0, 1)
    return Material((float(r), float(g), float(b)))


def hsv(rng: np.random.Generator, hue, saturation, value) -> np.ndarray:
    """sRGB of a colour drawn uniformly from ranges of hue, saturation and value."""
    return np.array(
        colorsys.hsv_to_rgb(rng.uniform(*hue) % 1.0, rng.uniform(*saturation), rng.uniform(*value))
    )


def noise(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """[64, 64] smooth noise of about unit range, from a rows x columns lattice."""
    lattice = rng.uniform(-1, 1, (rows, columns)).astype(np.float32)
    size = (TEXTURE_SIZE, TEXTURE_SIZE)
    return np.asarray(Image.fromarray(lattice).resize(size, Image.Resampling.BICUBIC))


def _shaded(rgb: np.ndarray, shade: np.ndarray) -> np.ndarray:
    """[64, 64, 3] uint8 of a colour times (1 + shade)."""
    return (np.clip(rgb * (1 + shade[..., None]), 0, 1) * 255 + 0.5).astype(np.uint8)


def wood(rng: np.random.Generator, *, textured: bool | None = None, grain: str = "z") -> Material:
    """Wood from pale birch to wenge; grained in two cases of three unless ``textured`` says."""
    tones = [
        ((0.09, 0.12), (0.22, 0.38), (0.80, 0.93)),  # birch, maple
        ((0.07, 0.10), (0.38, 0.55), (0.62, 0.80)),  # oak, pine
        ((0.03, 0.07), (0.50, 0.68), (0.40, 0.58)),  # cherry, teak
        ((0.04, 0.08), (0.42, 0.60), (0.24, 0.38)),  # walnut
        ((0.03, 0.09), (0.20, 0.45), (0.13, 0.22)),  # wenge
    ]
    rgb = hsv(rng, *tones[rng.choice(5, p=[0.25, 0.3, 0.2, 0.17, 0.08])])
    if not (rng.random() < 0.67 if textured is None else textured):
        return plain(rgb)
    shade = 0.13 * noise(rng, 3, int(rng.integers(10, 26))) + 0.07 * noise(rng, 5, 48)
    if rng.random() < 0.35:  # planks with dark joints
        count = int(rng.integers(3, 9))
        plank = np.arange(TEXTURE_SIZE) * count // TEXTURE_SIZE
        shade = shade + rng.uniform(-0.12, 0.12, count)[plank]
        joint = np.diff(plank, prepend=0) > 0
        shade = shade - 0.35 * joint
    tile = float(rng.uniform(0.7, 1.4))
    return Material(tuple(rgb.tolist()), _shaded(rgb, shade), grain, tile)


def paint(rng: np.random.Generator) -> Material:
    """Painted or laminated boards: whites and greys mostly, muted and now and then strong
    colours."""
    kind = rng.choice(5, p=[0.36, 0.2, 0.24, 0.12, 0.08])
    if kind == 0:
        return plain(hsv(rng, (0.05, 0.2), (0.0, 0.08), (0.86, 0.98)))
    if kind == 1:
        return plain(hsv(rng, (0, 1), (0.0, 0.06), (0.35, 0.8)))
    if kind == 2:
        return plain(hsv(rng, (0, 1), (0.15, 0.4), (0.4, 0.82)))
    if kind == 3:
        return plain(hsv(rng, (0, 1), (0.5, 0.85), (0.45, 0.9)))
    return plain(hsv(rng, (0, 1), (0.0, 0.15), (0.1, 0.24)))


def metal(rng: np.random.Generator, *, brushed: bool | None = None) -> Material:
    """Stainless or dark steel, sometimes with a brushed texture (one in three unless ``brushed``
    says)."""
    rgb = hsv(rng, (0.52, 0.64), (0.0, 0.07), (0.58, 0.82) if rng.random() < 0.8 else (0.3, 0.45))
    if not (rng.random() < 0.33 if brushed is None else brushed):
        return plain(rgb)
    shade = 0.06 * noise(rng, 3, 64) + 0.05 * noise(rng, 2, 6)
    return Material(tuple(rgb.tolist()), _shaded(rgb, shade), str(rng.choice(["y", "z"])), 1.2)


def stone(rng: np.random.Generator) -> Material:
    """Worktops: granite speckle or soft veins."""
    value = (0.75, 0.93) if rng.random() < 0.5 else (0.15, 0.5)
    rgb = hsv(rng, (0.02, 0.15), (0.0, 0.16), value)
    shade = 0.16 * noise(rng, 40, 40) if rng.random() < 0.6 else 0.14 * noise(rng, 7, 9)
    return Material(tuple(rgb.tolist()), _shaded(rgb, shade), "y", 1.2)


def glass(rng: np.random.Generator) -> Material:
    """What glass looks like to a camera without refraction: bluish pale or smoky dark."""
    if rng.random() < 0.5:
        return plain(hsv(rng, (0.5, 0.6), (0.08, 0.3), (0.6, 0.85)))
    return dark_glass(rng)


def dark_glass(rng: np.random.Generator) -> Material:
    """Black oven glass."""
    return plain(hsv(rng, (0.55, 0.7), (0.0, 0.25), (0.05, 0.16)))


def dark(rng: np.random.Generator) -> Material:
    """Black or charcoal plastic and rubber."""
    return plain(hsv(rng, (0, 1), (0.0, 0.1), (0.09, 0.27)))


def white_plastic(rng: np.random.Generator) -> Material:
    """The insides and panels of appliances."""
    return plain(hsv(rng, (0.1, 0.6), (0.0, 0.06), (0.82, 0.96)))


def casing(rng: np.random.Generator, shares) -> Material:
    """Steel, white or black, or plastic of any colour, in these four shares."""
    kind = rng.choice(4, p=shares)
    if kind == 3:
        return plain(hsv(rng, (0, 1), (0.3, 0.9), (0.3, 0.95)))
    return (metal, white_plastic, dark)[kind](rng)


def hardware(rng: np.random.Generator) -> Material:
    """Handles, knobs, feet: steel, black, brass or copper."""
    kind = rng.choice(4, p=[0.45, 0.27, 0.2, 0.08])
    if kind == 0:
        return metal(rng, brushed=False)
    if kind == 1:
        return dark(rng)
    if kind == 2:
        return plain(hsv(rng, (0.1, 0.14), (0.45, 0.7), (0.55, 0.8)))
    return plain(hsv(rng, (0.03, 0.06), (0.5, 0.65), (0.5, 0.75)))


def furniture(rng: np.random.Generator) -> Material:
    """A finish for furniture boards: wood or paint."""
    return wood(rng) if rng.random() < 0.58 else paint(rng)


def appliance(rng: np.random.Generator) -> Material:
    """A finish for an appliance's outside: white, steel, black, or a retro colour."""
    kind = rng.choice(4, p=[0.38, 0.36, 0.1, 0.16])
    if kind == 0:
        return white_plastic(rng)
    if kind == 1:
        return metal(rng)
    if kind == 2:
        return dark(rng)
    return plain(hsv(rng, (0, 1), (0.25, 0.7), (0.45, 0.85)))


def atlas(materials: list[Material], vertices: list[np.ndarray]) -> trimesh.visual.TextureVisuals:
    """One image with a band for each material, and the UVs of every vertex (v up; one texel of
    margin against bleeding)."""
    bands, spans, row = [], [], 0
    for material in materials:
        if material.image is not None:
            band = material.image
        else:
            color = (np.array(material.color) * 255 + 0.5).astype(np.uint8)
            band = np.broadcast_to(color, (4, TEXTURE_SIZE, 3))
        bands.append(band)
        spans.append((row, len(band)))
        row += len(band)
    uvs = []
    for material, points, (start, height) in zip(materials, vertices, spans, strict=True):
        local = (
            np.full((len(points), 2), 0.5) if material.image is None else material.project(points)
        )
        u = (1 + local[:, 0] * (TEXTURE_SIZE - 2)) / TEXTURE_SIZE
        v = 1 - (start + 1 + local[:, 1] * (height - 2)) / row
        uvs.append(np.column_stack([u, v]))
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(bands)))
    surface = trimesh.visual.material.PBRMaterial(
        baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.8
    )
    return trimesh.visual.TextureVisuals(uv=np.concatenate(uvs), material=surface)
