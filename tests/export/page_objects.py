"""Objects as pages, with shapes for their parts and names that a page must not run."""

from __future__ import annotations

import dataclasses

import numpy as np

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.glb import write_glb
from uniart_jax.export.page import write_page
from uniart_jax.export.physics import Box, Hull, Shape
from uniart_jax.objects.object import ArticulatedObject

HOSTILE = (
    "</script><script>window.pwned = 1</script>",
    "</script x",
    "<!-- <script x",
    "]]> & \"quoted\" 'name' {{glb}} \\1",
    "<img src=x onerror=window.pwned=1>",
    "\u2028line\u2029 name",
)


def make_solids(obj: ArticulatedObject) -> list[tuple[Shape]]:
    """A hull for every other part, a box for the rest."""
    shapes = []
    for k, part in enumerate(obj.parts):
        lo, hi = part.mesh.bounds * obj.scale
        shape = Box((lo + hi) / 2, hi - lo, np.eye(3))
        if k % 2 == 0:
            shape = Hull(part.mesh.convex_hull.copy().apply_scale(obj.scale))
        shapes.append((shape,))
    return shapes


def write_all(obj: ArticulatedObject, folder):
    atlas = make_atlas(obj, 128)
    textured = [s.textured(atlas.texture) for s in atlas.surfaces]
    glb = write_glb(obj, textured, folder / "object.glb")
    return write_page(obj, glb, make_solids(obj), folder / "view.html")


def renamed(obj: ArticulatedObject, names) -> ArticulatedObject:
    parts = list(obj.parts)
    for k, name in enumerate(names):
        parts[k] = dataclasses.replace(parts[k], name=name)
    return dataclasses.replace(obj, parts=tuple(parts), name=names[0])
