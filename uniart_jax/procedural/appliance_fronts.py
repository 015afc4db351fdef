"""What the fronts of real appliances look like: windows of many outlines, bowed handles, trim,
vents, and the finishes of their cases."""

from __future__ import annotations

import dataclasses

import numpy as np
from manifold3d import Manifold

from uniart_jax.procedural import appliances, finishes, materials, real_finishes
from uniart_jax.procedural.fronts import FrontStyle, handle
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Shape, box, cut, exact, extrusion, rounded

WINDOWS = ("rect", "rounded", "arched", "octagon", "none")


def outside(rng: np.random.Generator) -> Material:
    """The outside of an appliance: white, gray, plain or banded steel, black, cream, a strong
    colour; most without any tint."""
    pick = rng.choice(7, p=[0.26, 0.2, 0.13, 0.24, 0.06, 0.05, 0.06])
    if pick == 0:
        return finishes.white_plastic(rng)
    if pick == 1:
        return _gray(rng, 0.5, 0.9)
    if pick == 2:
        return finishes.varied(rng, materials.metal(rng), gray=0.7, gain=(0.9, 1.25))
    if pick == 3:
        if rng.random() < 0.2:
            return _striped(rng)
        return finishes.varied(rng, real_finishes.banded_steel(rng), gray=0.7, gain=(0.95, 1.3))
    if pick == 4:
        return finishes.dark(rng)
    if pick == 5:
        return materials.plain(np.array([0.93, 0.88, 0.72]) * rng.uniform(0.75, 1.05))
    return finishes.varied(rng, materials.appliance(rng), chroma=(1.0, 1.5), gain=(0.7, 1.1))


def _striped(rng: np.random.Generator) -> Material:
    """Steel in many narrow light and dark stripes, as a small tile repeated makes it."""
    value, count = rng.uniform(0.5, 0.8), rng.uniform(5, 24)
    wave = np.sin(2 * np.pi * count * np.arange(materials.TEXTURE_SIZE) / materials.TEXTURE_SIZE)
    shade = value * (1 + rng.uniform(0.06, 0.3) * wave)
    image = np.broadcast_to(shade[None, :, None], (*[materials.TEXTURE_SIZE] * 2, 3))
    pixels = (np.clip(image, 0, 0.996) * 255).astype(np.uint8)
    return Material((value, value, value), pixels, str(rng.choice(["y", "z"], p=[0.3, 0.7])), 1.5)


def _gray(rng: np.random.Generator, low: float, high: float) -> Material:
    """A plain gray, on two in three exactly."""
    tint = 0.0 if rng.random() < 0.67 else rng.uniform(-0.02, 0.02, 3)
    return materials.plain(np.full(3, rng.uniform(low, high)) + tint)


def case_of(rng: np.random.Generator, face: Material) -> Material:
    """The finish of the case behind a front: the front's, a darker one, black or gray."""
    pick = rng.choice(4, p=[0.52, 0.14, 0.1, 0.24])
    if pick == 0:
        return face
    if pick == 1:
        return face.darker(float(rng.uniform(0.5, 1.0)))
    return finishes.dark(rng) if pick == 2 else _gray(rng, 0.3, 0.9)


def pane(rng: np.random.Generator) -> Material:
    """A window's glass: black, gray, or vivid."""
    pick = rng.choice(4, p=[0.42, 0.18, 0.32, 0.08])
    if pick == 0:
        return materials.dark_glass(rng)
    if pick == 1:
        return materials.plain(np.full(3, rng.uniform(0.25, 0.65)))
    return real_finishes.tinted_glass(rng) if pick == 2 else real_finishes.speckled(rng)


def appliance_style(
    rng: np.random.Generator, unit: float, face: Material, thickness: float
) -> FrontStyle:
    """Slab fronts in an appliance's manner, ``thickness`` metres thick."""
    look = appliances.style(
        rng,
        unit,
        face,
        handles=("bar", "bar", "round_bar", "arch", "bow", "bow", "bow", "lip", "recess", "none"),
        own_handle=0.03,
    )
    return dataclasses.replace(
        look,
        thickness=thickness,
        accent=face.darker(float(rng.uniform(0.4, 1.0))),
        glass=pane(rng),
        handle_length=float(rng.uniform(0.4, 0.95)),
        hardware=look.hardware if rng.random() < 0.7 else face,
    )


def across(outline, y0: float, y1: float) -> Manifold:
    """An outline [n, 2] of (z, x) pushed from ``y0`` to ``y1``, on the binary grid of
    ``shapes.box``: faces that should be flush with a box are."""
    a, b = exact([y0, y1])
    return extrusion(exact(outline), "y", [0, a, 0], b - a)


def bow(
    face: float, at: tuple[float, float], along: str, length: float, reach: float, width: float
) -> Manifold:
    """A handle that is bowed out of the plane x = ``face``, centred at ``at`` (y, z)."""
    t = np.linspace(-1, 1, 11)
    outer = np.column_stack([t * length / 2, -reach * (1 - t**4)])
    inner = np.column_stack([t * (length / 2 - 1.2 * width), -(reach - width) * (1 - t**4)])[::-1]
    outline = np.vstack([outer, inner])  # (along, x - face)
    y, z = at
    if along == "z":
        return extrusion(outline, "y", [face, y - width / 2, z], width)
    return extrusion(outline[:, ::-1], "z", [face, y, z - width / 2], width)


def _outline(kind: str, width: float, height: float, rng) -> np.ndarray:
    """A window's outline [n, 2] about 0."""
    w, h = width / 2, height / 2
    if kind == "rounded":
        return rounded(width, height, float(rng.uniform(0.06, 0.4)) * min(width, height))
    if kind == "octagon":
        c = float(rng.uniform(0.12, 0.35)) * min(width, height)
        return np.array(
            [[w, c - h], [w, h - c], [w - c, h], [c - w, h],
             [-w, h - c], [-w, c - h], [c - w, -h], [w - c, -h]]
        )  # fmt: skip
    if kind == "arched":
        t = np.linspace(1, -1, 9)
        rise = float(rng.uniform(0.1, 0.4)) * height
        arch = np.column_stack([t * w, h - rise * t**2])
        return np.vstack([[[-w, -h], [w, -h]], arch])
    return np.array([[w, -h], [w, h], [-w, h], [-w, -h]])


def window_kind(rng: np.random.Generator) -> str:
    """One of ``WINDOWS``, in the shares of real doors."""
    return str(rng.choice(WINDOWS, p=[0.5, 0.24, 0.08, 0.06, 0.12]))


def window(
    rng: np.random.Generator, face: float, y: tuple[float, float], z: tuple[float, float],
    look: FrontStyle, kind: str | None = None,
) -> Shape:  # fmt: skip
    """A pane of glass on the plane x = ``face`` within a rectangle, on some with a rim or within a
    larger plate of another colour."""
    shape = Shape()
    kind = window_kind(rng) if kind is None else kind
    wide, tall = y[1] - y[0], z[1] - z[0]
    if kind == "none" or min(wide, tall) < 4 * look.unit:
        return shape
    at = [0.0, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2]
    proud = float(rng.uniform(0.0006, 0.003))
    if rng.random() < 0.4:
        width, height = wide, tall
    else:
        width, height = wide * float(rng.uniform(0.55, 1)), tall * float(rng.uniform(0.45, 1))
        at[2] += float(rng.uniform(-0.5, 0.5)) * (tall - height)
    outer = _outline(kind, width, height, rng)
    at[0] = face - proud
    if rng.random() < 0.45:
        rim = float(rng.uniform(0.5, 3.0)) * look.unit
        share = 1 - 2 * min(rim, 0.2 * min(width, height)) / np.array([width, height])
        inner = extrusion(outer * share, "x", at, proud)
        large = [at[0] - 1, *at[1:]]
        frame = cut(extrusion(outer, "x", at, proud), [extrusion(outer * share, "x", large, 2.0)])
        pick = rng.choice(3, p=[0.5, 0.3, 0.2])
        edge = (finishes.dark(rng), look.accent, finishes.metal(rng, brushed=False))[pick]
        return shape.add(frame, edge).add(inner, look.glass)
    return shape.add(extrusion(outer, "x", at, proud), look.glass)


def dressed(
    rng: np.random.Generator, lo, hi, free: str, look: FrontStyle, *, pane_kind: str | None = None
) -> tuple[FrontStyle, Shape]:
    """A style for one front between two corners, and what is on it: a window, trim, a bowed
    handle near its ``free`` edge ('+z', '+y', '-y')."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    face, unit = float(lo[0]), look.unit
    shape, wide, tall = Shape(), hi[1] - lo[1], hi[2] - lo[2]
    inset = min(max(0.04, 2.6 * unit), 0.3 * min(wide, tall))  # where ``fronts`` puts handles
    zone = inset + max(0.012, 1.3 * unit)
    y, z = [float(lo[1]), float(hi[1])], [float(lo[2]), float(hi[2])]
    edge = float(rng.uniform(0.6, 4.0)) * unit
    if free == "+z":
        z[1] -= zone if look.handle != "none" else 0.0
    elif free == "+y":
        y[1] -= zone if look.handle != "none" else 0.0
    else:
        y[0] += zone if look.handle != "none" else 0.0
    inner_y, inner_z = (y[0] + edge, y[1] - edge), (z[0] + edge, z[1] - edge)
    if min(inner_y[1] - inner_y[0], inner_z[1] - inner_z[0]) > 3 * unit:
        shape.join(window(rng, face, inner_y, inner_z, look, pane_kind))
    if rng.random() < 0.2 and free == "+z":
        at = (lo[1] + hi[1]) / 2 + wide * float(rng.choice([0.0, 0.32, -0.32]))
        ink = finishes.dark(rng) if look.face.color[1] > 0.4 else finishes.white_plastic(rng)
        w = 0.45 * edge
        shape.add(
            box([face - 0.001, at - 3 * w, lo[2] + w], [face, at + 3 * w, lo[2] + 2 * w]), ink
        )
    if look.handle != "bow":
        return look, shape
    along, room = ("y", wide) if free[1] == "z" else ("z", tall)
    length = min(look.handle_length, 0.96) * room
    reach = max(0.02, float(rng.uniform(1.6, rng.choice([4.5, 8.0]))) * unit)
    width = max(0.008, float(rng.uniform(0.8, 1.6)) * unit)
    at_y, at_z = (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2
    if free == "+z":
        at_z = hi[2] - inset
    else:
        at_y = hi[1] - inset if free == "+y" else lo[1] + inset
    shape.add(bow(face, (at_y, at_z), along, length, reach, width), look.hardware)
    return dataclasses.replace(look, handle="none"), shape


def false_front(body: Shape, rng, lo, hi, look: FrontStyle) -> None:
    """A board that looks as a drawer or a door does, and does not open: plain, or with a handle."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    body.add(box(lo, hi), look.face)
    wide, tall = hi[1] - lo[1], hi[2] - lo[2]
    if rng.random() < 0.35 and look.handle not in ("none", "lip", "recess", "latch") and tall > 0.1:
        at = ((lo[1] + hi[1]) / 2, hi[2] - 0.3 * tall)
        if look.handle == "bow":
            width = max(0.008, 1.1 * look.unit)
            bar = bow(float(lo[0]), at, "y", 0.6 * wide, 2.4 * look.unit, width)
            body.add(bar, look.hardware)
        else:
            body.join(handle(look, float(lo[0]), at, "y", 0.5 * wide))


def vents(body: Shape, rng, face: float, y, z, material: Material) -> None:
    """Dark slots across the plane x = ``face`` within a rectangle."""
    count = int(rng.integers(2, 7))
    pitch = (z[1] - z[0]) / count
    for k in range(count):
        low = z[0] + (k + 0.25) * pitch
        body.add(box([face - 0.0008, y[0], low], [face, y[1], low + 0.5 * pitch]), material)


def badge(body: Shape, rng, face: float, y: float, z: float, unit: float, ink: Material) -> None:
    """A maker's name: a small plate or a few letters."""
    w, h = float(rng.uniform(2, 6)) * unit, float(rng.uniform(0.4, 1.2)) * unit
    if rng.random() < 0.5:
        body.add(box([face - 0.001, y - w, z - h], [face, y + w, z + h]), ink)
        return
    for a in np.linspace(y - w, y + w, 6)[:-1]:
        body.add(box([face - 0.0008, a, z - h], [face, a + 0.28 * w, z + h]), ink)
