"""The asset folder: everything that a person or a simulator needs of one articulated object,
complete or absent.

object.urdf   object.xml (MJCF)   object.usda, object.usdz   meshes/<part>.obj, material.mtl, texture.png, collision/<part>_*.obj
object.glb    view.html           print/<part>.stl           preview.png   motion.gif   report.json
"""  # noqa: E501

from __future__ import annotations

import concurrent.futures
import dataclasses
import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from uniart_jax.export.atlas import Atlas, make_atlas
from uniart_jax.export.bodies import make_bodies, with_joints
from uniart_jax.export.budget import check_budget, within_budget
from uniart_jax.export.closing import is_bounded
from uniart_jax.export.collision_kinds import check_collision
from uniart_jax.export.folder import check_target, complete_folder
from uniart_jax.export.formats import (
    COLLISION_BUDGET,
    FORMATS,
    SIMULATORS,
    Collision,
    Format,
    Origin,
    Parts,
    default_formats,
)
from uniart_jax.export.frames import hulls
from uniart_jax.export.glb import write_glb
from uniart_jax.export.naming import named
from uniart_jax.export.page import write_page
from uniart_jax.export.physics import Body
from uniart_jax.export.picture_colors import Picture
from uniart_jax.export.placement import check_origin, moved_bodies, moved_surfaces, place
from uniart_jax.export.preview import (
    choose_view,
    read_image,
    view_of_code,
    with_meshes,
    write_motion,
    write_preview,
)
from uniart_jax.export.printing.settings import PrintSettings
from uniart_jax.export.printing.write import write_print
from uniart_jax.export.report import AsRead, make_report, write_report
from uniart_jax.export.resistance import Resistance, check_resistance, resisting
from uniart_jax.export.size import resized
from uniart_jax.export.stl import write_stl
from uniart_jax.export.urdf import write_urdf
from uniart_jax.export.wavefront import (
    TEXTURE_FILE,
    write_material,
    write_plain,
    write_textured,
)
from uniart_jax.objects.object import ArticulatedObject

Check = Callable[[Path], dict]
Mend = Callable[
    [ArticulatedObject, Sequence[Body], Sequence[trimesh.Trimesh], int | None, Collision],
    tuple[ArticulatedObject, Sequence[Body]],
]


def save_asset(
    obj: ArticulatedObject,
    folder: str | Path,
    *,
    formats: Sequence[Format] | None = None,
    size: float | None = None,
    density: float | None = None,
    mass: float | None = None,
    collision: Collision = "merged",
    collision_budget: int | None = COLLISION_BUDGET,
    friction: Resistance | None = None,
    damping: Resistance | None = None,
    origin: Origin | None = "floor",
    actuators: bool = False,
    printing: PrintSettings | None = None,
    image: str | Path | np.ndarray | Image.Image | None = None,
    picture: Picture | None = None,
    seed: int | None = None,
    checkpoint: str = "",
    details: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    motion: bool = True,
    mend: Mend | None = None,
    check: Check | None = None,
) -> Path:
    """Write an object as a folder that simulators load as it is. Metres, kilograms, radians.

    It is written closed: joint zero is the rest state, and coordinates grow as joints open
    (``export.placement``). Parts without a name of their own are called after their joints
    (``export.naming``).

    Args:
      obj: any articulated object; ``scale`` turns it into metres.
      formats: what to write beside the URDF, its meshes, the pictures and the report: "mjcf"
        (object.xml), "glb", "page" (view.html), "usd" (object.usda and object.usdz; needs
        usd-core), "stl" (a file a part in millimetres, for printing). Default:
        ``default_formats()``.
      folder: where to; made with its parents. It appears complete or not at all.
      size: metres of the longest side; default as ``obj.scale`` says.
      density: kg / m^3 of every part (default 500, light wood). mass: kg of the whole object
        instead.
      collision: "merged": boxes and hulls as close to the surface as the budget allows; "boxes"
        alone; "hull": one a part; "coacd": that program's (``export.collision_kinds``).
      collision_budget: convex shapes of the whole object at most, 16 a part (``export.budget``);
        None: as many as follow the surface.
      friction, damping: a factor for all joints, or numbers by the joint's name in the files
        (``export.resistance``); default: what a hand can move (``export.dynamics``).
      origin: "floor": 0 lies on the floor below the middle of the object at rest; "centre": in its
        middle; None: where the object has it.
      actuators: MJCF gets a position actuator a joint.
      printing: with "stl", ``print`` holds pieces with hinges, shafts and slides that print and are
        put together (``export.printing``), instead of the parts as they are.
      image: the picture that the object was made from, shown beside it in ``preview.png``.
      picture: the same with its camera, of the shown state: the texture takes its colours
        (``export.picture_colors``).
      seed, checkpoint: what made the object, for the report. details: further entries of it, plain
        JSON values.
      overwrite: replace a folder that holds an asset; the old one stands until the new one is
        complete.
      motion: also write ``motion.gif`` (if anything moves).
      mend: mends joints and shapes once these are known, and keeps them within the budget
        (``simulation.refine.mend``).
      check: looks at the folder before it takes its place, in a thread beside the making of its
        pictures, which may be missing then, and returns the report's ``validation``
        (``simulation.validate``). An error in the pictures is raised once it has ended.

    Returns:
      The folder.

    Raises:
      ValueError: ``check_target`` refuses the folder, it cannot be made, ``image`` cannot be read,
        an unknown format or one whose package is absent, ``printing`` without "stl", a size,
        density, mass or origin that cannot be, or friction or damping of a joint that is not there.
    """
    chosen = default_formats() if formats is None else tuple(formats)
    if unknown := [f for f in chosen if f not in FORMATS]:
        raise ValueError(f"save: unknown format '{unknown[0]}'; there are {', '.join(FORMATS)}")
    if printing is not None and "stl" not in chosen:
        raise ValueError("save: printing needs the format 'stl' (--print: add --formats stl)")
    inputs = [image] if isinstance(image, str | Path) else []
    if collision_budget is not None:
        check_budget(collision_budget)
    check_collision(collision)
    check_origin(origin)
    check_target(folder, overwrite, inputs)
    beside = None if image is None else read_image(image)
    given = obj.parts
    obj = named(obj if size is None else resized(obj, size))
    for option, resistance in (("friction", friction), ("damping", damping)):
        check_resistance(option, resistance, obj)
    with complete_folder(folder, overwrite) as target:
        atlas = make_atlas(obj, picture=picture)
        weights = {"density": density, "mass": mass}
        bodies = make_bodies(obj, atlas.unclosed, collision=collision, **weights)
        if mend is not None:
            obj, bodies = mend(obj, bodies, atlas.unclosed, collision_budget, collision)
        elif collision_budget is not None:
            boxes = collision == "boxes"
            bodies = within_budget(obj, bodies, atlas.unclosed, collision_budget, boxes=boxes)
        placed = place(obj, origin)
        bodies = with_joints(moved_bodies(bodies, placed.moved, obj.scale), placed.obj)
        bodies = resisting(placed.obj, bodies, friction, damping)
        stood = dataclasses.replace(atlas, surfaces=moved_surfaces(atlas.surfaces, placed.moved))
        notes = _write_simulation(placed.obj, stood, bodies, target, chosen, actuators)
        notes += _write_stl(placed.obj, stood, target, chosen, printing)
        textured = [surface.textured(atlas.texture) for surface in stood.surfaces]
        if "glb" in chosen or "page" in chosen:
            glb = write_glb(placed.obj, textured, target / "object.glb")
            if "page" in chosen:
                shapes = [body.shapes for body in bodies]
                write_page(placed.obj, glb, shapes, target / "view.html")
            if "glb" not in chosen:
                glb.unlink()
        closed = [is_bounded(surface.faces) for surface in atlas.surfaces]
        read = AsRead(obj, tuple(part.name for part in given), placed.shown)
        report = make_report(placed.obj, bodies, closed, seed, checkpoint, notes, read)
        report |= {"origin": origin, "collision": collision} | dict(details or {})
        write_report(report, target / "report.json")
        with concurrent.futures.ThreadPoolExecutor(1) as beside_pictures:  # engines are processes
            checking = None if check is None else beside_pictures.submit(check, target)
            textured = [surface.textured(atlas.texture) for surface in atlas.surfaces]
            shown = with_meshes(obj, textured).normalized()
            camera = None if picture is None else picture.camera
            view = choose_view(shown, beside) if camera is None else view_of_code(camera)
            write_preview(shown, target / "preview.png", beside, view)
            if motion:
                write_motion(shown, target / "motion.gif", view)
            if checking is not None:
                report["validation"] = checking.result()
                write_report(report, target / "report.json")
    return Path(folder)


def _write_simulation(
    obj: ArticulatedObject,
    atlas: Atlas,
    bodies: Sequence[Body],
    folder: Path,
    formats: Sequence[Format],
    actuators: bool,
) -> tuple[str, ...]:
    """Meshes and what simulators read of them; what a format could not say, a line each."""
    meshes = folder / "meshes"
    (meshes / "collision").mkdir(parents=True)
    atlas.texture.save(meshes / TEXTURE_FILE, compress_level=9)
    write_material(meshes)
    stems = file_stems(obj)
    visual, hull_files = [], []
    for stem, surface, body in zip(stems, atlas.surfaces, bodies, strict=True):
        write_textured(surface, meshes / f"{stem}.obj", obj.scale)
        visual.append(f"meshes/{stem}.obj")
        hull_files.append([f"meshes/collision/{stem}_{i}.obj" for i in range(len(hulls(body)))])
        for hull, file in zip(hulls(body), hull_files[-1], strict=True):
            write_plain(hull.mesh, folder / file)
    write_urdf(obj, folder, [[file] for file in visual], bodies, hull_files)
    opened = [
        len(s.faces) != len(m.faces) for s, m in zip(atlas.surfaces, atlas.unclosed, strict=True)
    ]
    named = [f"'{part.name}'" for part, was_open in zip(obj.parts, opened, strict=True) if was_open]
    notes = [f"open surfaces were given a thickness: {', '.join(named)}"] if named else []
    texture = f"meshes/{TEXTURE_FILE}"
    parts = Parts(obj, folder, atlas.surfaces, bodies, visual, hull_files, texture, actuators)
    for name, module in SIMULATORS.items():
        if name in formats:
            notes += importlib.import_module(f"uniart_jax.export.{module}").write_asset(parts)
    return tuple(notes)


def _write_stl(
    obj: ArticulatedObject,
    atlas: Atlas,
    folder: Path,
    formats: Sequence[Format],
    printing: PrintSettings | None,
) -> tuple[str, ...]:
    """STL files if they are asked for, of the parts or of pieces to print; notes, a line each."""
    if "stl" not in formats:
        return ()
    stems, where = file_stems(obj), folder / "print"
    if printing is None:
        return write_stl(obj, where, atlas.surfaces, stems)
    return write_print(obj, where, atlas.surfaces, stems, printing)


def file_stems(obj: ArticulatedObject) -> list[str]:
    """[K] file stems of the parts: their names as far as every file system and parser takes them,
    told apart where need be."""
    stems: list[str] = []
    for part in obj.parts:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", part.name).strip("_")[:80] or "part"
        name, count = stem, 1
        while name.lower() in {s.lower() for s in stems}:
            count += 1
            name = f"{stem}_{count}"
        stems.append(name)
    return stems
