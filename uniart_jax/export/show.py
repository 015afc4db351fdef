"""An object in the browser: the page with a slider for every joint, opened from disk.

The page of an asset of ours is its ``view.html``. For any other object that can be read, and for
one that lies only in memory, a page is made in a temporary folder, which is removed when the
program ends.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from uniart_jax.export.atlas import make_atlas
from uniart_jax.export.bodies import make_bodies
from uniart_jax.export.glb import write_glb
from uniart_jax.export.naming import named
from uniart_jax.export.page import write_page
from uniart_jax.export.physics import Hull, Shape
from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.load import READERS, find_asset, kind_of, load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot_object import make_object

PAGE = "view.html"


def show(
    asset: ArticulatedObject | str | Path,
    *,
    open_browser: bool = True,
    wait: bool | None = None,
    allow_outside: bool = False,
) -> Path:
    """Open an object's page in the browser, and print where it lies.

    Args:
      asset: an object, or what ``load_object`` reads: a folder, URDF, MJCF or JSON. Where an
        asset's ``view.html`` lies beside it and is not older, this is the page.
      open_browser: open it, if there is a display; else the path is only printed.
      wait: keep a temporary page until Ctrl-C. Default: yes, but in an interactive session
        (Python's prompt, a notebook), where it stays until the session ends.
      allow_outside: as ``load_object`` takes it.

    Returns:
      The page.

    Raises:
      ValueError: the asset cannot be read. FileNotFoundError: there is none.
    """
    page = None
    if not isinstance(asset, ArticulatedObject):
        page = page_beside(find_asset(asset, allow_outside=allow_outside))
    temporary = page is None
    if page is None:
        page = make_page(asset, temporary_folder() / PAGE, allow_outside=allow_outside)
    wait = temporary and (not hasattr(sys, "ps1") if wait is None else wait)
    try:
        print(f"{page}" + ("  (Ctrl-C removes it)" if wait else ""), flush=True)
        if open_browser and has_display():
            webbrowser.open(page.as_uri())
        if wait:
            threading.Event().wait()
    except KeyboardInterrupt:
        if not wait:
            raise
        shutil.rmtree(page.parent, ignore_errors=True)
        print("removed")
    return page


def page_beside(description: Path) -> Path | None:
    """``view.html`` beside an asset's description, absolute, if it is not older than that."""
    page = description.parent.resolve() / PAGE
    is_file = page.is_file() and not page.is_symlink()
    return page if is_file and page.stat().st_mtime >= description.stat().st_mtime else None


def make_page(
    asset: ArticulatedObject | str | Path, path: Path, *, allow_outside: bool = False
) -> Path:
    """Write the page of any object, as it is at its shown state.

    Collision shapes are those that the asset's file holds; those that an export would hold if the
    object lies in memory.

    Args:
      asset: an object, or what ``load_object`` reads.
      path: the .html file; an object.glb is written beside it and removed.

    Raises:
      ValueError, FileNotFoundError: as ``load_object``.
    """
    if isinstance(asset, ArticulatedObject):
        obj = named(asset)
        shapes = [body.shapes for body in make_bodies(obj, [p.mesh for p in obj.parts])]
    else:
        obj = load_object(asset, allow_outside=allow_outside)
        try:
            shapes = read_shapes(asset, obj, allow_outside=allow_outside)
        except (ValueError, OSError) as error:
            print(f"{asset}: the page shows no collision shapes: {error}", file=sys.stderr)
            shapes = [[] for _ in obj.parts]
    atlas = make_atlas(obj)
    textured = [surface.textured(atlas.texture) for surface in atlas.surfaces]
    glb = write_glb(obj, textured, path.with_name("object.glb"))
    write_page(obj, glb, shapes, path)
    glb.unlink()
    return path


def read_shapes(
    path: str | Path, obj: ArticulatedObject, *, allow_outside: bool = False
) -> list[Sequence[Shape]]:
    """[K] collision geometry that an asset's file holds for the parts of ``obj``, which was read
    from it; metres, object frame. A mesh is taken as it is, convex or not.

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
    return [[Hull(meshes[p.name])] if p.name in meshes else [] for p in obj.parts]


def temporary_folder() -> Path:
    """A new folder that is removed when the program ends."""
    folder = Path(tempfile.mkdtemp(prefix="uniart-view-")).resolve()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def has_display() -> bool:
    """Whether a browser with a window can open; in a terminal alone a text browser would."""
    if sys.platform in ("win32", "darwin"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
