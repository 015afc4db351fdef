"""Reading an articulated object, whatever it was written as: one call, ``load_object``.

    object.urdf, any other URDF          urdf_read           any simulator's, with what real ones get wrong

A reader makes a ``Robot`` of the file; ``robot_object`` makes the object. Every repair is one line of ``ArticulatedObject.provenance``.
"""

from __future__ import annotations

from pathlib import Path

from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot_mesh import AssetFiles
from uniart_jax.objects.robot_object import make_object, one_line
from uniart_jax.objects.urdf_read import MAX_BYTES, read_robot


def find_urdf(path: str | Path) -> Path:
    """The URDF that ``path`` means: itself, or in a folder object.urdf, mobility.urdf or the only ``*.urdf``.

    Raises:
      FileNotFoundError: nothing there. ValueError: a folder with several URDFs.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such file or folder")
    for name in ("object.urdf", "mobility.urdf"):
        if (path / name).is_file():
            return path / name
    found = sorted(path.glob("*.urdf"))
    if len(found) > 1:
        names = ", ".join(f.name for f in found[:4])
        raise ValueError(
            f"{path}: the folder holds {len(found)} URDFs ({names} ...): name one of them"
        )
    if not found:
        raise FileNotFoundError(
            f"{path}: the folder holds no URDF (object.urdf, mobility.urdf or one *.urdf)"
        )
    return found[0]


def load_object(path: str | Path, *, allow_outside: bool = False) -> ArticulatedObject:
    """An articulated object from a URDF file or a folder that holds one.

    Args:
      path: the file or folder; its folder is the asset's root.
      allow_outside: also read meshes and textures outside that root (``../meshes``, absolute paths, links).

    Returns:
      The object in metres (``scale`` 1, not normalised) in the URDF's world frame, shown at joint coordinate 0 where the limits
      allow. Parts are the links that have a mesh. ``provenance`` holds one line for each repair.

    Raises:
      FileNotFoundError: no such file. ValueError: it cannot be read as one tree of parts; one line that names the file, the link
        or joint, and what to do.
    """
    path = find_urdf(path)
    try:
        with path.open("rb") as file:
            robot = read_robot(file.read(MAX_BYTES + 1))
        return make_object(robot, AssetFiles(path.parent, allow_outside), path.stem)
    except (ValueError, OSError, RuntimeError, OverflowError) as error:
        raise ValueError(one_line(f"{path}: {error}")) from None
