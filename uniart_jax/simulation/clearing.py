"""Collision shapes cut back where a joint scrapes them along each other.

The surfaces of a generated object are rough, and its joints lie a little beside where they should:
bumps of two parts that the image shows apart then catch on each other on the way. What is as
shallow as that is cut off the shapes, each by a plane so that it stays convex; what stands in the
way for good is left to ``refine`` (limits) and to ``validate``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from uniart_jax.export.collision import rebuilt
from uniart_jax.export.physics import Body
from uniart_jax.export.separation import apart, as_solid
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.simulation.collider import Collider, Pair

LEAST = 0.004  # of the object's longest side: shapes that share less are left as they are
SHALLOW = 0.03  # those that share more, anywhere on the way, too
STATES = 9  # of a joint's range
ROUNDS = 2
MOST_LOST = 0.5  # of a shape's volume


def clear(
    obj: ArticulatedObject, bodies: Sequence[Body]
) -> tuple[tuple[Body, ...], tuple[str, ...]]:
    """The bodies with shapes that let every joint through where less than .03 of the object was in
    its way.

    Args:
      obj: any object. bodies: [K] of its parts (``export.bodies.make_bodies``).

    Returns:
      The bodies, and a line for each pair of parts whose shapes were cut.
    """
    lo, hi = obj.bounds
    size = float((hi - lo).max()) * obj.scale
    first = [as_solid(shape).volume() for body in bodies for shape in body.shapes]
    least = [(1 - MOST_LOST) * volume for volume in first]
    deepest: dict[Pair, float] = {}
    for _ in range(ROUNDS):
        collider = Collider(obj, bodies)
        worst: dict[Pair, tuple[float, np.ndarray]] = {}
        for poses in _poses(obj):
            for pair, depth in collider.shape_depths(poses).items():
                if depth > max(LEAST * size, worst.get(pair, (0.0, poses))[0]):
                    worst[pair] = depth, poses
        shapes = [shape for body in bodies for shape in body.shapes]
        solids = {n: as_solid(shapes[n]) for pair in worst for n in pair}
        cut: set[int] = set()
        for (i, j), (depth, poses) in sorted(worst.items()):
            owners = int(collider.owner[i]), int(collider.owner[j])
            if depth > SHALLOW * size:
                continue
            frames = [_metric(poses[k], obj.scale) for k in owners]
            halves = apart(
                *(solids[n].transform(f[:3]) for n, f in zip((i, j), frames, strict=True)),
                LEAST * size / 2,
            )
            if halves is None:
                continue
            back = [h.transform(np.linalg.inv(f)[:3]) for h, f in zip(halves, frames, strict=True)]
            if back[0].volume() < least[i] or back[1].volume() < least[j]:
                continue
            solids[i], solids[j] = back
            cut |= {i, j}
            parts = min(owners), max(owners)
            deepest[parts] = max(deepest.get(parts, 0.0), depth)
        for n in cut:  # a sliver stays as it was
            shapes[n] = rebuilt(solids[n], size) or shapes[n]
        given = iter(shapes)
        bodies = tuple(
            dataclasses.replace(b, shapes=tuple(next(given) for _ in b.shapes)) if cut else b for b in bodies  # noqa: E501
        )  # fmt: skip
        if not cut:
            break
    lines = [
        f"refine: collision shapes of '{obj.parts[a].name}' and '{obj.parts[b].name}' cut back by "
        f"up to {depth:.3g} m where they scrape along each other"
        for (a, b), depth in sorted(deepest.items())
    ]
    return tuple(bodies), tuple(lines)


def _metric(pose: np.ndarray, scale: float) -> np.ndarray:
    """[4, 4] in metres."""
    pose = pose.copy()
    pose[:3, 3] *= scale
    return pose


def _poses(obj: ArticulatedObject) -> Iterator[np.ndarray]:
    """[K, 4, 4]: as shown, at rest, and every joint over its range with the others so."""
    shown, rest = np.zeros(len(obj.parts)), obj.rest()
    for others in [shown, rest] if rest.any() else [shown]:
        yield obj.forward_kinematics(others)
        for k, (lo, hi) in enumerate(obj.limits):
            for q in np.linspace(lo, hi, STATES) if hi > lo else ():
                state = others.copy()
                state[k] = q
                yield obj.forward_kinematics(state)
