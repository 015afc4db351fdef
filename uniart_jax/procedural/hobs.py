"""What stands on a cooktop: gas burners under cast-iron grates, coils, glass with printed rings,
griddles, ribbed covers."""

from __future__ import annotations

import itertools

import numpy as np
from manifold3d import CrossSection, Manifold

from uniart_jax.procedural import finishes, materials
from uniart_jax.procedural.materials import Material
from uniart_jax.procedural.shapes import Shape, box, cylinder, tube, union

HOBS = ("grates", "crosses", "coils", "glass", "ribs", "plain")


def add_hob(
    body: Shape, rng: np.random.Generator, lo, hi, unit: float, kind: str | None = None
) -> None:
    """A cooktop over the rectangle (``lo``, ``hi``: x, y and the height of the top) of one of
    ``HOBS``."""
    (x0, y0, z), (x1, y1, _) = (np.asarray(v, dtype=np.float64) for v in (lo, hi))
    if kind is None:
        kind = str(rng.choice(HOBS, p=[0.46, 0.16, 0.1, 0.16, 0.06, 0.06]))
    wide, deep = y1 - y0, x1 - x0
    if kind == "ribs":
        count, iron = int(rng.integers(7, 16)), finishes.dark(rng)
        w, h = 0.3 * wide / count, max(0.008, float(rng.uniform(0.8, 2.0)) * unit)
        for y in np.linspace(y0 + w, y1 - w, count):
            body.add(box([x0, y - w, z], [x1, y + w, z + h]), iron)
        return
    plate = max(0.004, 0.6 * unit)
    base = _plate_finish(rng, kind)
    body.add(box([x0, y0, z], [x1, y1, z + plate]), base)
    if kind == "plain":
        return
    spots = burner_spots(rng, (x0, x1), (y0, y1), 2 if wide < 1.35 * deep else 3)
    top = z + plate
    largest = 0.44 * min(deep / 2, wide / max(2, len({round(s[1], 3) for s in spots})))
    mark = finishes.dark(rng) if base.color[1] > 0.3 else materials.plain((0.4, 0.38, 0.38))
    if kind == "glass" and rng.random() < 0.3:
        mark = materials.plain((rng.uniform(0.6, 0.95), 0.1, 0.08))
    for x, y, share in spots:
        _burner(body, rng, kind, (x, y, top), share * largest, unit, mark)
    if kind in ("grates", "crosses"):
        iron = finishes.dark(rng) if rng.random() < 0.85 else finishes.metal(rng, brushed=False)
        rise = max(0.022, float(rng.uniform(1.8, 4.5)) * unit)
        bar = max(0.006, float(rng.uniform(0.55, 1.1)) * unit)
        if kind == "grates":
            columns = len({round(s[1], 3) for s in spots})
            for a, b in itertools.pairwise(np.linspace(y0, y1, columns + 1)):
                edge = float(rng.uniform(0.02, 0.05)) * deep
                near = [x0 + edge, a + 0.4 * edge, top]
                body.add(_grate(rng, near, [x1 - edge, b - 0.4 * edge, top + rise], bar), iron)
        else:
            for x, y, share in spots:
                r = 1.12 * share * largest
                body.add(_cross((x, y, top), r, rise, bar), iron)


def _plate_finish(rng: np.random.Generator, kind: str) -> Material:
    """What a cooktop is made of."""
    if kind == "glass":
        return materials.dark_glass(rng)
    pick = rng.choice(3, p=[0.4, 0.35, 0.25])
    return (finishes.metal(rng, brushed=False), finishes.dark(rng), finishes.white_plastic(rng))[
        pick
    ]


def burner_spots(rng, x: tuple[float, float], y: tuple[float, float], columns: int):
    """Centres (x, y) of burners, and the share of the largest radius that each has."""
    columns += int(rng.random() < 0.25)
    ys = y[0] + (np.arange(columns) + 0.5) * (y[1] - y[0]) / columns
    rows = np.array([0.27, 0.75]) * (x[1] - x[0]) + x[0]
    single = int(rng.integers(columns)) if columns > 2 and rng.random() < 0.4 else -1
    spots = []
    for k, v in enumerate(ys):
        if k == single:
            spots.append((float(rows.mean()), float(v), 1.0))
            continue
        spots += [(float(u), float(v), float(rng.uniform(0.55, 0.95))) for u in rows]
    return spots


def _burner(body: Shape, rng, kind: str, at, radius: float, unit: float, mark: Material) -> None:
    """One burner, coil or printed ring on the plane z = at[2]."""
    r = radius
    if kind == "glass":
        body.add(tube("z", at, 0.0008, r, 0.86 * r, 28), mark)
        if rng.random() < 0.5:
            body.add(tube("z", at, 0.0008, 0.55 * r, 0.45 * r, 20), mark)
        return
    if kind == "coils":
        h = max(0.008, 1.1 * unit)
        for far in (1.0, 0.72, 0.44):
            body.add(tube("z", at, h, far * r, (far - 0.16) * r, 20), mark)
        return
    h = max(0.008, 1.0 * unit)
    body.add(cylinder("z", at, 0.6 * h, 0.62 * r, 0.5 * r, segments=16), mark)
    cap = [at[0], at[1], at[2] + 0.6 * h]
    body.add(cylinder("z", cap, 0.6 * h, 0.42 * r, 0.38 * r, segments=16), mark)


def _grate(rng, lo, hi, bar: float) -> Manifold:
    """A cast-iron grate on feet: a frame with bars across and along."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    low, w, inside = hi[2] - 1.4 * bar, bar / 2, 0.15 * bar
    flat = _rectangle(lo, hi) - _rectangle(lo[:2] + bar, hi[:2] - bar)
    across, along = int(rng.integers(2, 7)), int(rng.integers(1, 4))
    for x in np.linspace(lo[0], hi[0], across + 2)[1:-1]:
        flat += _rectangle((x - w, lo[1] + w), (x + w, hi[1] - w))
    for y in np.linspace(lo[1], hi[1], along + 2)[1:-1]:
        flat += _rectangle((lo[0] + w, y - w), (hi[0] - w, y + w))
    solids = [Manifold.extrude(flat, hi[2] - low).translate((0, 0, low))]
    for x in (lo[0] + inside, hi[0] - bar + inside):
        for y in (lo[1] + inside, hi[1] - bar + inside):
            far = [x + bar - 2 * inside, y + bar - 2 * inside, hi[2] - 0.5 * bar]
            solids.append(box([x, y, lo[2]], far))
    return union(solids)


def _rectangle(lo, hi) -> CrossSection:
    """A rectangle between two corners (x, y)."""
    return CrossSection(
        [np.array([[lo[0], lo[1]], [hi[0], lo[1]], [hi[0], hi[1]], [lo[0], hi[1]]])]
    )


def _cross(at, radius: float, rise: float, bar: float) -> Manifold:
    """A pan support of one burner: a ring on two crossing bars that stand on the top."""
    x, y, z = at
    w = bar / 2
    low = z + rise - 1.4 * bar
    solids = [tube("z", [x, y, low], 1.3 * bar, radius, radius - bar, 20)]
    solids.append(box([x - 1.25 * radius, y - w, low], [x + 1.25 * radius, y + w, z + rise]))
    solids.append(box([x - w, y - 1.25 * radius, low], [x + w, y + 1.25 * radius, z + rise]))
    for sx, sy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        cx, cy = x + sx * (1.25 * radius - w), y + sy * (1.25 * radius - w)
        solids.append(box([cx - w, cy - w, z], [cx + w, cy + w, low + bar]))
    return union(solids)
