"""Articulated objects as people know them: parts with meshes, a tree, joints, appearance.

Frame: right-handed, z up, front faces -x. Every mesh and joint is in the object frame at the
*shown* state, in which every joint coordinate is 0 (docs/representation.md, "Frames").
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from uniart_jax.objects.kinematics import (
    ANGLE_DEAD_ZONE,
    TRAVEL_DEAD_ZONE,
    Joint,
    codable,
    forward_kinematics,
    topological_order,
)
from uniart_jax.objects.several_joints import lowering, one_joint

State = Sequence[float] | np.ndarray | dict[str, float]  # [K] coordinates, or part name -> q


def bounds_at(obj: ArticulatedObject, q: State) -> np.ndarray:
    """[K, 2, 3] lower and upper corners of every part at state ``q``."""
    moved = zip(obj.parts, obj.forward_kinematics(q), strict=True)
    return np.array([moved_mesh(part.mesh, matrix).bounds for part, matrix in moved])


def moved_mesh(mesh: trimesh.Trimesh, matrix: np.ndarray) -> trimesh.Trimesh:
    """A copy of ``mesh`` moved by [4, 4], mirrors included; it shares its material with the
    original.

    ``Trimesh.copy`` would copy every texture, which costs more than all else when one object is
    shown at many states.
    """
    vertices = trimesh.transform_points(mesh.vertices, matrix)
    mirrored = np.linalg.det(np.asarray(matrix)[:3, :3]) < 0
    faces = np.ascontiguousarray(mesh.faces[:, ::-1]) if mirrored else np.array(mesh.faces)
    visual = mesh.visual
    if isinstance(visual, TextureVisuals):
        uv = None if visual.uv is None else np.array(visual.uv)
        visual = TextureVisuals(uv=uv, material=visual.material)
    elif visual.kind == "face":  # ``copy`` would work out the vertices' colours too
        visual = ColorVisuals(face_colors=np.array(visual.face_colors))
    else:
        visual = visual.copy()
    return trimesh.Trimesh(vertices, faces, visual=visual, process=False)


@dataclasses.dataclass(frozen=True)
class Part:
    """One rigid body.

    Attributes:
      name: unique in its object.
      mesh: surface in the object frame at the shown state; closed where the source is. Its visual
        is a texture with UVs or face / vertex colours (sRGB), read by ``objects.appearance``.
      parent: index of the parent part, -1 for the root.
      joint: how it moves relative to its parent; ``Joint.fixed()`` for the root.
      label: for people and baselines only; no network ever sees it.
      outer, inner: further joints, each with a coordinate of its own that states do not hold (it is
        0, as shown): those between the parent and ``joint``, and those between ``joint`` and the
        part, each from the parent down. Files keep them; codes hold one joint a part
        (``several_joints.one_joint``).
    """

    name: str
    mesh: trimesh.Trimesh
    parent: int = -1
    joint: Joint = dataclasses.field(default_factory=Joint.fixed)
    label: str = ""
    outer: tuple[Joint, ...] = ()
    inner: tuple[Joint, ...] = ()

    @property
    def chain(self) -> tuple[Joint, ...]:
        """All joints between the parent and the part, from the parent down."""
        return (*self.outer, self.joint, *self.inner)

    def with_joints(
        self, change: Callable[[Joint], Joint], inner: Callable[[Joint], Joint] | None = None
    ) -> Part:
        """The part with every joint changed; those of ``inner`` by their own function if given."""
        return dataclasses.replace(
            self,
            joint=change(self.joint),
            outer=tuple(map(change, self.outer)),
            inner=tuple(map(inner or change, self.inner)),
        )

    @property
    def box(self) -> np.ndarray:
        """[6] centre and size of the part's own axis-aligned box at the shown state."""
        lo, hi = self.mesh.bounds
        return np.concatenate([(lo + hi) / 2, hi - lo])


@dataclasses.dataclass(frozen=True)
class ArticulatedObject:
    """A tree of parts. Parents stand before their children; part 0 is the root.

    Attributes:
      parts: [K] parts, parents first (sorted when made, names kept).
      scale: metres per object unit.
      name, category: metadata for people; no network sees them.
      provenance: repairs made on the way, one readable line each.
      from_voxels: whether its surfaces were found on voxels, as a network's. Its collision shapes
        are then boxes of cells (``export.voxel_boxes``).

    Raises:
      ValueError: no parts, an empty mesh, several roots, a cycle, or a repeated name.
    """

    parts: tuple[Part, ...]
    scale: float = 1.0
    name: str = ""
    category: str = ""
    provenance: tuple[str, ...] = ()
    from_voxels: bool = False

    def __repr__(self) -> str:
        tree = ", ".join(
            part.name if part.parent < 0 else f"{part.name} ({part.joint.type})"
            for part in self.parts[:8]
        )
        tree += ", ..." if len(self.parts) > 8 else ""
        of = f", {self.category}" if self.category else ""
        unit = "1 unit = 1 m" if self.scale == 1 else f"1 unit = {self.scale:.4g} m"
        return (
            f"ArticulatedObject({self.name or 'unnamed'}{of}: {len(self.parts)} parts: {tree}; "
            f"{unit})"
        )

    def __post_init__(self):
        parts = tuple(self.parts)
        if not parts:
            raise ValueError("object: it has no parts")
        for part in parts:
            if len(part.mesh.faces) == 0:
                raise ValueError(f"object: part '{part.name}' has no faces")
            if not np.isfinite(part.mesh.bounds).all():  # of vertices that faces use
                raise ValueError(
                    f"object: part '{part.name}' has vertices that are not finite numbers; remove "
                    "their faces"
                )
        names = [p.name for p in parts]
        if len(set(names)) != len(names):
            repeated = next(n for n in names if names.count(n) > 1)
            raise ValueError(f"object: two parts are named '{repeated}'")
        order = topological_order([p.parent for p in parts])
        if order != list(range(len(parts))):
            position = {old: new for new, old in enumerate(order)}
            parts = tuple(
                dataclasses.replace(parts[old], parent=position.get(parts[old].parent, -1))
                for old in order
            )
        object.__setattr__(self, "parts", parts)

    @property
    def parents(self) -> list[int]:
        return [p.parent for p in self.parts]

    @property
    def joints(self) -> list[Joint]:
        return [p.joint for p in self.parts]

    @property
    def boxes(self) -> np.ndarray:
        """[K, 6] centre and size of every part's own box at the shown state."""
        return np.stack([p.box for p in self.parts])

    @property
    def limits(self) -> np.ndarray:
        """[K, 2] (lo, hi) of every coordinate; (0, 0) for the root and fixed joints."""
        return np.array([p.joint.limits for p in self.parts], dtype=np.float64)

    @property
    def bounds(self) -> np.ndarray:
        """[2, 3] corners of the whole object's box at the shown state."""
        corners = np.stack([p.mesh.bounds for p in self.parts])
        return np.stack([corners[:, 0].min(0), corners[:, 1].max(0)])

    def index(self, name: str) -> int:
        """Index of the part called ``name``; ValueError if there is none."""
        for i, part in enumerate(self.parts):
            if part.name == name:
                return i
        raise ValueError(f"object: no part is named '{name}'")

    def coordinates(self, q: State | None) -> np.ndarray:
        """[K] joint coordinates from an array, a dictionary part name -> q, or None (the shown
        state)."""
        if q is None:
            return np.zeros(len(self.parts))
        if isinstance(q, dict):
            state = np.zeros(len(self.parts))
            for name, value in q.items():
                state[self.index(name)] = value
            return state
        state = np.asarray(q, dtype=np.float64)
        if state.shape != (len(self.parts),):
            raise ValueError(f"object: expected q of shape ({len(self.parts)},), got {state.shape}")
        return state

    def forward_kinematics(self, q: State | None = None) -> np.ndarray:
        """[K, 4, 4] transforms from the shown state to state ``q``."""
        return forward_kinematics(self.parents, self.joints, self.coordinates(q))

    def transformed(self, matrix: np.ndarray) -> ArticulatedObject:
        """The object moved by a similarity [4, 4], mirrors included. ``scale`` is left as it is."""
        parts = []
        for part in self.parts:
            part = part.with_joints(lambda joint: joint.transformed(matrix))
            parts.append(dataclasses.replace(part, mesh=moved_mesh(part.mesh, matrix)))
        return dataclasses.replace(self, parts=tuple(parts))

    def shown_at(self, q: State) -> ArticulatedObject:
        """The same object whose shown state is ``q``: meshes moved, axes moved by their ancestors,
        coordinates measured from q."""
        q = self.coordinates(q)
        moved = self.forward_kinematics(q)
        parts = []
        for k, part in enumerate(self.parts):
            shown = dataclasses.replace(part, mesh=moved_mesh(part.mesh, moved[k]))
            if part.parent >= 0:
                above, own = moved[part.parent], moved[k]
                shown = dataclasses.replace(shown, joint=part.joint.shown_at(q[k])).with_joints(
                    lambda joint, by=above: joint.transformed(by),
                    lambda joint, by=own: joint.transformed(by),
                )
            parts.append(shown)
        return dataclasses.replace(self, parts=tuple(parts))

    def normalized(self) -> ArticulatedObject:
        """Centred at 0 with the shown state's longest side 1; ``scale`` takes up the factor.

        Motions that networks cannot tell from none (``kinematics.codable``: 1 degree, .005) are
        held, and of several joints of a part one is left (``several_joints.one_joint``), each a
        line of ``provenance``: to keep them, save the object as it is.
        """
        lo, hi = self.bounds
        side = float((hi - lo).max())
        if side <= 0:
            raise ValueError("object: it has no extent")
        matrix = np.eye(4)
        matrix[:3, :3] /= side
        matrix[:3, 3] = -(lo + hi) / (2 * side)
        moved = self.transformed(matrix)
        single = moved.single_jointed()
        parts = tuple(dataclasses.replace(p, joint=codable(p.joint)) for p in single.parts)
        held = tuple(
            f"joint of '{p.name}': a motion of less than 1 degree, or .005 of the object, was held"
            for p, q in zip(single.parts, parts, strict=True)
            if (p.joint.rotates, p.joint.travels) != (q.joint.rotates, q.joint.travels)
        )
        notes = single.provenance + held
        return dataclasses.replace(moved, parts=parts, scale=self.scale * side, provenance=notes)

    def single_jointed(self) -> ArticulatedObject:
        """The object with one joint a part, as codes have it (``several_joints.one_joint``); what
        was lowered is a line of ``provenance``."""
        left = [one_joint(p.outer, p.joint, p.inner) for p in self.parts]
        lines = tuple(
            lowering(p.name, p.chain, joint)
            for p, joint in zip(self.parts, left, strict=True)
            if len(p.chain) > 1
        )
        parts = tuple(
            dataclasses.replace(p, joint=joint, outer=(), inner=())
            for p, joint in zip(self.parts, left, strict=True)
        )
        return dataclasses.replace(self, parts=parts, provenance=self.provenance + lines)

    def rest(self) -> np.ndarray:
        """[K] the rest state.

        Per joint: the limit nearest 0 if 0 is within the codes' dead zone of it (1 degree, .005 of
        the longest side), else the end at which the object's bounding volume
        (all other joints at 0) is smaller, the lower end on ties; continuous joints: 0.
        """
        q = np.zeros(len(self.parts))
        near = TRAVEL_DEAD_ZONE * float(np.ptp(self.bounds, axis=0).max())
        for k, part in enumerate(self.parts):
            joint = part.joint
            if part.parent < 0 or joint.type in ("fixed", "continuous"):
                continue
            lo, hi = joint.limits
            dead = ANGLE_DEAD_ZONE if joint.rotates else near
            if min(-lo, hi) <= dead:
                q[k] = lo if -lo <= hi else hi
                continue
            volumes = []
            for end in (lo, hi):
                state = np.zeros(len(self.parts))
                state[k] = end
                corners = self._moved_bounds(state)
                volumes.append(float(np.prod(corners[1] - corners[0])))
            q[k] = hi if volumes[1] < volumes[0] * (1 - 1e-6) else lo
        return q

    def _moved_bounds(self, q: np.ndarray) -> np.ndarray:
        points = [
            trimesh.transform_points(part.mesh.vertices, matrix)
            for part, matrix in zip(self.parts, self.forward_kinematics(q), strict=True)
        ]
        return np.stack(
            [np.min([p.min(0) for p in points], 0), np.max([p.max(0) for p in points], 0)]
        )

    def open(self, fraction: float = 1.0) -> np.ndarray:
        """[K] the state ``fraction`` of the way from rest to the end farther from rest; continuous
        joints turn by 90 degrees."""
        rest = self.rest()
        q = rest.copy()
        for k, joint in enumerate(self.joints):
            lo, hi = joint.limits
            if joint.type == "continuous":
                q[k] = fraction * np.pi / 2
            elif joint.type != "fixed":
                far = hi if abs(hi - rest[k]) >= abs(lo - rest[k]) else lo
                q[k] = rest[k] + fraction * (far - rest[k])
        return q

    def mesh(self, q: State | None = None) -> trimesh.Trimesh:
        """All parts at state ``q`` as one mesh without appearance."""
        moved = []
        for part, matrix in zip(self.parts, self.forward_kinematics(q), strict=True):
            vertices = trimesh.transform_points(part.mesh.vertices, matrix)
            moved.append(trimesh.Trimesh(vertices, part.mesh.faces, process=False))
        return trimesh.util.concatenate(moved)

    def save(self, folder: str | Path, **options) -> Path:
        """Write the asset folder (URDF, MJCF, GLB, meshes, page, previews, report); see
        ``export.asset.save_asset``."""
        from uniart_jax.export.asset import save_asset

        return save_asset(self, folder, **options)

    def validate(self, **options) -> dict:
        """Load the object, written as an asset, in the physics engines and drive its joints; see
        ``simulation.validate.validate``."""
        from uniart_jax.export.asset import save_asset
        from uniart_jax.simulation.validate import validate

        with tempfile.TemporaryDirectory(prefix="uniart-") as folder:
            asset = save_asset(self, Path(folder) / "asset", formats=("mjcf",), motion=False)
            return validate(asset, **options)

    def show(self, **options) -> Path:
        """Open a page in the browser with a slider for every joint; see ``export.show.show``."""
        from uniart_jax.export.show import show

        return show(self, **options)
