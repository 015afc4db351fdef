"""An articulated object in the browser, served by viser: a slider a joint, axes with limits,
collision shapes, part colours, play.

``view.html`` in an asset's folder (``export.page``) needs no server and shows what was written;
this shows any object that can be read, ours or another's, and one that lies only in memory.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import importlib.util
import io
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.transformations import quaternion_from_matrix

from uniart_jax.export.frames import moves
from uniart_jax.export.page import JointSymbol, joint_symbol
from uniart_jax.export.physics import Box, Shape
from uniart_jax.export.preview import DEFAULT_VIEW
from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.load import READERS, find_asset, kind_of, load_object
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.robot_mesh import AssetFiles
from uniart_jax.objects.robot_object import make_object
from uniart_jax.render import PART_COLORS

SECONDS = 2.4  # from rest to open
FRAMES = 30  # a second
SMOOTH = np.deg2rad(35)  # faces that meet at less are shaded as one surface
STATES = ("Rest", "Shown", "Open")


def view(
    asset: ArticulatedObject | str | Path,
    *,
    port: int = 8080,
    open_browser: bool = True,
    block: bool = True,
    allow_outside: bool = False,
) -> Viewer | None:
    """Show an object at ``http://localhost:PORT`` (this machine only).

    Args:
      asset: an object, or what ``load_object`` reads: a folder, URDF, MJCF or JSON.
      port: the first to try; the next free one is taken, and the address printed.
      open_browser: also open the page.
      block: return when Ctrl-C is pressed; else at once.
      allow_outside: as ``load_object`` takes it.

    Returns:
      With ``block=False`` the viewer, to be stopped by the caller.

    Raises:
      ValueError: viser is not installed, or the asset cannot be read. FileNotFoundError: there is
        none.
    """
    if not has_viser():
        raise ValueError("view: needs viser: pip install 'uniart-jax[view]'")
    if isinstance(asset, ArticulatedObject):
        obj = asset
        load_shapes = functools.partial(made_shapes, obj)
    else:
        obj = load_object(asset, allow_outside=allow_outside)
        load_shapes = functools.partial(read_shapes, asset, obj, allow_outside=allow_outside)
    viewer = Viewer(obj, load_shapes, port)
    print(f"{obj.name or 'object'}: {viewer.address}" + ("  (Ctrl-C stops)" if block else ""))
    if open_browser:
        webbrowser.open(viewer.address)
    if not block:
        return viewer
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        print("stopped")
    finally:
        viewer.stop()
    return None


def has_viser() -> bool:
    """Whether the extra ``view`` is installed."""
    return importlib.util.find_spec("viser") is not None


def made_shapes(obj: ArticulatedObject) -> list[list[trimesh.Trimesh]]:
    """[K] convex pieces that an export of the object would hold, metres, object frame at the shown
    state."""
    from uniart_jax.export.bodies import make_bodies

    bodies = make_bodies(obj, [p.mesh for p in obj.parts])
    return [[_shape_mesh(shape) for shape in body.shapes] for body in bodies]


def read_shapes(
    path: str | Path, obj: ArticulatedObject, *, allow_outside: bool = False
) -> list[list[trimesh.Trimesh]]:
    """[K] collision geometry that an asset's file holds for the parts of ``obj``, which was read
    from it; metres, object frame.

    Every link is read once more with its collision geometry in place of its visuals: where parts
    stand at the shown state does not depend on what they look like. A part without any gets an
    empty list.

    Raises:
      ValueError: it cannot be read.
    """
    found = find_asset(path, allow_outside=allow_outside)
    files = AssetFiles(found.parent, allow_outside)
    data = found.read_bytes()
    robot = READERS[kind_of(data, found)](data, found, files)
    for link in robot.links.values():
        link.visuals, link.collisions = link.collisions, []
    if not any(link.visuals for link in robot.links.values()):
        return [[] for _ in obj.parts]
    solid = make_object(robot, files, found.stem)
    meshes = {part.name: part.mesh for part in solid.parts}
    return [[meshes[p.name]] if p.name in meshes else [] for p in obj.parts]


def _shape_mesh(shape: Shape) -> trimesh.Trimesh:
    if not isinstance(shape, Box):
        return shape.mesh
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = shape.rotation, shape.center
    return trimesh.creation.box(extents=shape.size, transform=matrix)


class Viewer:
    """A page that shows one object.

    Args:
      obj: the object.
      load_shapes: its collision shapes, asked for when they are first looked at (a decomposition
        takes seconds).
      port: the first to try.

    Attributes:
      address: of the page.
    """

    def __init__(
        self,
        obj: ArticulatedObject,
        load_shapes: Callable[[], list[list[trimesh.Trimesh]]],
        port: int,
    ):
        import viser

        self.obj = obj
        self.load_shapes = load_shapes
        self.rest, self.opened = obj.rest(), obj.open()
        self.moving = [k for k, part in enumerate(obj.parts) if moves(part)]
        self._q = np.zeros(len(obj.parts))
        self._lock = threading.RLock()
        self._playing: threading.Event | None = None
        title = obj.name or "Articulated object"
        with contextlib.redirect_stdout(io.StringIO()):  # its banner
            self.server = viser.ViserServer(host="localhost", port=port, label=title, verbose=False)
        self.address = f"http://localhost:{self.server.get_port()}"
        self._build_scene()
        self._build_panel(title)
        self.set_state(self._q)

    @property
    def state(self) -> np.ndarray:
        """[K] joint coordinates now, radians and object units."""
        return self._q.copy()

    def set_state(self, q: np.ndarray) -> None:
        """Show the object at state ``q`` [K], within the limits."""
        with self._lock, self.server.atomic():
            limits = self.obj.limits
            self._q = np.clip(np.asarray(q, dtype=np.float64), limits[:, 0], limits[:, 1])
            moved = self.obj.forward_kinematics(self._q)
            for frame, matrix in zip(self._frames, moved, strict=True):
                frame.wxyz = quaternion_from_matrix(matrix)
                frame.position = matrix[:3, 3] * self.obj.scale
            for k, slider in self._sliders.items():
                slider.value = float(
                    np.clip(self._q[k] * self._unit(k), slider.min, slider.max).round(2)
                )

    def stop(self) -> None:
        """End the page and its server."""
        self.pause()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def _unit(self, k: int) -> float:
        """Degrees per radian, or millimetres per object unit: what people read."""
        return np.rad2deg(1.0) if self.obj.parts[k].joint.rotates else 1000 * self.obj.scale

    def _build_scene(self) -> None:
        obj, scene = self.obj, self.server.scene
        states = (np.zeros(len(obj.parts)), self.rest, self.opened)
        corners = np.concatenate([obj.mesh(q).bounds for q in states]) * obj.scale
        lo, hi = corners.min(0), corners.max(0)
        center, size = (lo + hi) / 2, float(np.linalg.norm(hi - lo))
        scene.set_up_direction("+z")
        cell = 10.0 ** np.floor(np.log10(size / 3))
        scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=cell,
            section_size=10 * cell,
            fade_distance=6 * size,
            position=(0.0, 0.0, lo[2]),
        )
        self.server.initial_camera.look_at = center
        away = DEFAULT_VIEW.position / DEFAULT_VIEW.distance
        self.server.initial_camera.position = center + away * size
        self._frames, self._textured, self._flat = [], [], []
        self._shapes: list[Any] | None = None
        self._axes: list[Any] = []
        for k, part in enumerate(obj.parts):
            self._frames.append(scene.add_frame(f"/parts/{k}", show_axes=False))
            mesh = _shaded(part.mesh, obj.scale)
            data = io.BytesIO(mesh.export(file_type="glb", include_normals=True))
            self._textured.append(scene.add_glb(f"/parts/{k}/mesh", data.getvalue()))
            self._flat.append(
                scene.add_mesh_simple(
                    f"/parts/{k}/flat",
                    np.asarray(part.mesh.vertices) * obj.scale,
                    np.asarray(part.mesh.faces),
                    color=_color(k),
                    flat_shading=True,
                    visible=False,
                )
            )
        for k in self.moving:
            symbol = joint_symbol(obj.parts[k], float(self.opened[k] - self.rest[k]))
            self._add_axis(k, obj.parts[k], symbol, 0.0035 * size)

    def _add_axis(self, k: int, part: Part, symbol: JointSymbol, thick: float) -> None:
        """The axis and the anchor's way from limit to limit stand with the parent; a bead shows
        where the part is."""
        scene, scale, color = self.server.scene, self.obj.scale, _color(k, 0.72)
        stem = f"/parts/{part.parent}/axis{k}"
        way = anchor_way(part.joint, symbol.anchor) * scale
        lines = np.stack([way[:-1], way[1:]], 1)
        if part.joint.rotates:
            d = part.joint.direction
            foot = part.joint.origin + d * float(d @ (symbol.anchor - part.joint.origin))
            half = (symbol.reach * scale + 12 * thick) * d
            ends = np.stack([foot * scale - half, foot * scale + half])
        else:
            ends = way[[0, -1]] if self.opened[k] >= self.rest[k] else way[[-1, 0]]
        arrow = scene.add_arrows(
            f"{stem}/arrow",
            ends[None],
            color,
            shaft_radius=thick * 0.8,
            head_radius=thick * 2.6,
            head_length=thick * 7,
            visible=False,
        )
        curve = scene.add_line_segments(
            f"{stem}/way", lines, color, thickness=2 * thick, visible=False
        )
        bead = scene.add_icosphere(
            f"/parts/{k}/bead",
            radius=2.4 * thick,
            color=color,
            position=symbol.anchor * scale,
            visible=False,
        )
        self._axes += [arrow, curve, bead]

    def _build_panel(self, title: str) -> None:
        obj, gui = self.obj, self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        size = " × ".join(f"{s:.2f}" for s in (obj.bounds[1] - obj.bounds[0]) * obj.scale)
        gui.set_panel_label(title)
        gui.add_text("Object", f"{len(obj.parts)} parts, {size} m", disabled=True)
        self._sliders: dict[int, Any] = {}
        if self.moving:
            states = gui.add_button_group("State", STATES)
            states.on_click(lambda event: self._go(event.target.value))
            self._play_button = gui.add_button("Play")
            self._play_button.on_click(lambda _: self.pause() if self._playing else self.play())
        for k in self.moving:
            self._sliders[k] = self._add_slider(k)
        with gui.add_folder("Display"):
            axes = gui.add_checkbox("Joint axes", False)
            axes.on_update(lambda _: self._show(self._axes, axes.value))
            self._collision = gui.add_checkbox("Collision", False)
            self._collision.on_update(lambda _: self._show_collision())
            colors = gui.add_checkbox("Part colours", False)
            self._colors = colors
            colors.on_update(lambda _: self._show_parts())

    def _add_slider(self, k: int) -> Any:
        part, unit = self.obj.parts[k], self._unit(k)
        digits = 1 if np.ptp(part.joint.limits) * unit > 2 else 3
        lo, hi = (float(np.round(limit * unit, digits)) for limit in part.joint.limits)
        step = 10.0**-digits
        what = f"{part.name} ({'°' if part.joint.rotates else 'mm'})"
        hint = f"{part.joint.type}, {lo:.4g} to {hi:.4g}"
        slider = self.server.gui.add_slider(what, lo, hi, step, min(max(0.0, lo), hi), hint=hint)

        def moved(event) -> None:
            if event.client is None:  # set by this program
                return
            self.pause()
            q = self.state
            ends = dict(zip((lo, hi), part.joint.limits, strict=True))  # rounded for display
            q[k] = ends.get(slider.value, slider.value / unit)
            self.set_state(q)

        slider.on_update(moved)
        return slider

    def _go(self, state: str) -> None:
        self.pause()
        self.set_state({"Rest": self.rest, "Open": self.opened}.get(state, np.zeros(len(self._q))))

    def play(self) -> None:
        """Move all joints from rest to open and back, on and on."""
        self.pause()
        if not self.moving:
            return
        stop = self._playing = threading.Event()
        self._play_button.label = "Pause"

        def run() -> None:
            frame = 0
            while not stop.wait(1 / FRAMES):
                frame += 1
                t = frame / FRAMES / SECONDS % 2
                t = min(t, 2 - t)
                share = t * t * (3 - 2 * t)
                with self._lock:
                    if not stop.is_set():
                        self.set_state(self.rest + (self.opened - self.rest) * share)

        threading.Thread(target=run, daemon=True).start()

    def pause(self) -> None:
        """Stand still."""
        with self._lock:
            if self._playing is not None:
                self._playing.set()
                self._playing = None
                self._play_button.label = "Play"

    def _show(self, handles: Sequence[Any], visible: bool) -> None:
        with self.server.atomic():
            for handle in handles:
                handle.visible = visible

    def _show_parts(self) -> None:
        self._show(self._textured, not self._colors.value and not self._collision.value)
        self._show(self._flat, self._colors.value and not self._collision.value)

    def _show_collision(self) -> None:
        """The parts give way to the shapes, which lie in their surfaces."""
        with self._lock:
            if self._shapes is None:
                self._collision.hint = "being computed"
                try:
                    shapes = self.load_shapes()
                except (ValueError, OSError) as error:
                    self._collision.hint, shapes = str(error), []
                self._shapes = [
                    self._add_shape(k, i, mesh)
                    for k, meshes in enumerate(shapes)
                    for i, mesh in enumerate(meshes)
                ]
                if not shapes or not self._shapes:
                    self._collision.label = "Collision (there is none)"
                    self._collision.value, self._collision.disabled = False, True
        self._show(self._shapes, self._collision.value)
        self._show_parts()

    def _add_shape(self, k: int, i: int, mesh: trimesh.Trimesh) -> Any:
        return self.server.scene.add_mesh_simple(
            f"/parts/{k}/collision{i}",
            np.asarray(mesh.vertices),
            np.asarray(mesh.faces),
            color=_color(k, 1.0 if i % 2 == 0 else 0.82),
            opacity=0.55,
            flat_shading=True,
            visible=False,
        )


def anchor_way(joint: Joint, anchor: np.ndarray) -> np.ndarray:
    """[n, 3] where a point of a moving part goes from one limit to the other: a segment, an arc or
    a helix."""
    lo, hi = joint.limits
    count = max(8, int(np.ceil((hi - lo) / 0.07))) + 1 if joint.rotates else 2
    moved = np.stack([joint.motion(q) for q in np.linspace(lo, hi, count)])
    return moved[:, :3, :3] @ anchor + moved[:, :3, 3]


def _color(k: int, share: float = 1.0) -> tuple[int, int, int]:
    r, g, b = np.round(PART_COLORS[k % len(PART_COLORS)] * 255 * share).astype(int).tolist()
    return r, g, b


def _shaded(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    """A copy in metres, colours kept, with its vertices split along sharp edges, so that they are
    drawn sharp."""
    out = mesh.copy()
    if hasattr(mesh.visual, "material"):
        out.visual.material = copy.copy(mesh.visual.material)
    out = trimesh.graph.smooth_shade(out.apply_scale(scale), angle=SMOOTH)
    if out.visual.kind != "face":
        return out
    corners = np.asarray(out.faces).ravel()  # GLB knows colours of vertices only
    return trimesh.Trimesh(
        out.vertices[corners],
        np.arange(len(corners)).reshape(-1, 3),
        vertex_normals=out.vertex_normals[corners],
        vertex_colors=np.repeat(np.asarray(out.visual.face_colors), 3, axis=0),
        process=False,
    )
