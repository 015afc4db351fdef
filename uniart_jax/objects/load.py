"""Reading an articulated object, whatever it was written as: one call, ``load_object``.

    object.urdf, any URDF                    urdf_read          any simulator's, with what real ones get wrong
    mobility.urdf beside mobility_v2.json    partnet_mobility   PartNet-Mobility's folder, the JSON telling the joints
    object.json, train.json (CAGE)           singapo            SINGAPO's, DIPO's and CAGE's
    nap.npz                                  nap                NAP's, by tools/export_nap.py
    object.xml, any MJCF                     mjcf               MuJoCo's, by its own parser

A reader makes a ``Robot`` of the file; ``robot_object`` makes the object. Every repair is one line
of ``ArticulatedObject.provenance``.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.json_text import parse_json
from uniart_jax.objects.mjcf import read_mjcf
from uniart_jax.objects.names import one_line
from uniart_jax.objects.nap import NAME as NAP
from uniart_jax.objects.nap import read_nap
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.partnet_mobility import is_partnet, read_partnet
from uniart_jax.objects.robot import Robot
from uniart_jax.objects.robot_object import make_object
from uniart_jax.objects.singapo import read_singapo
from uniart_jax.objects.urdf_read import read_robot
from uniart_jax.objects.xml_text import MAX_BYTES, parse_xml

NAMES = (
    "object.urdf",
    "mobility.urdf",
    "object.json",
    "train.json",
    "object.xml",
    NAP,
)  # the first that is there
OURS, REPORT = ("object.urdf", "object.xml"), "report.json"  # as ``export.asset`` writes them
READERS: dict[str, Callable[[bytes, Path, AssetFiles], Robot]] = {
    "urdf": lambda data, path, files: read_robot(data),
    "partnet": read_partnet,
    "mjcf": read_mjcf,
    "singapo": lambda data, path, files: read_singapo(data, files),
    "nap": lambda data, path, files: read_nap(data, files),
}


def find_asset(path: str | Path, *, allow_outside: bool = False) -> Path:
    """The description that ``path`` means: itself, or in a folder the first of ``NAMES``, else the
    only URDF, else the only MJCF.

    Args:
      allow_outside: take a link in a folder that leads out of it; a file that ``path`` names may
        always be one.

    Raises:
      FileNotFoundError: nothing there. ValueError: a folder with several, or the one lies outside.
        OSError: it cannot be looked at.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such file or folder")
    for name in NAMES:
        if (path / name).is_file():
            return _inside(path / name, allow_outside)
    found = [p for p in sorted(path.glob("*.urdf")) if p.is_file()]
    xmls = () if found else (p for p in sorted(path.glob("*.xml")) if p.is_file())
    found = found or [p for p in xmls if kind_of(_read(_inside(p, allow_outside)), p) == "mjcf"]
    if len(found) > 1:
        names = ", ".join(f.name for f in found[:4]) + (", ..." if len(found) > 4 else "")
        raise ValueError(
            f"{path}: the folder holds {len(found)} descriptions ({names}): name one of them"
        )
    if not found:
        raise FileNotFoundError(
            f"{path}: the folder holds no URDF, MJCF or object.json ({', '.join(NAMES)}, one "
            "*.urdf or one *.xml)"
        )
    return _inside(found[0], allow_outside)


def _inside(path: Path, allow_outside: bool) -> Path:
    if not allow_outside and not path.resolve().is_relative_to(path.parent.resolve()):
        raise ValueError(
            f"{path}: it lies outside the asset's folder; allow_outside=True (--allow-outside) "
            "reads it"
        )
    return path


def kind_of(data: bytes, path: Path) -> str:
    """Which of ``READERS`` a file is for: by its suffix, and an ``.xml`` by its root element."""
    if path.suffix.lower() == ".json":
        return "singapo"
    if path.suffix.lower() == ".npz":
        return "nap"
    if path.suffix.lower() in (".xml", ".mjcf"):
        try:
            return "mjcf" if parse_xml(data, []).tag == "mujoco" else "urdf"
        except ValueError:  # the URDF reader says what is wrong with it
            return "urdf"
    return "partnet" if is_partnet(path) else "urdf"


def _read(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MAX_BYTES + 1)


def load_object(
    path: str | Path, *, allow_outside: bool = False, within: Path | None = None
) -> ArticulatedObject:
    """An articulated object from a URDF, an MJCF, SINGAPO's ``object.json``, NAP's ``nap.npz``, or
    a folder that holds one.

    Args:
      path: the file or folder; its folder is the asset's root.
      allow_outside: also read meshes, textures and includes outside that root (``../meshes``,
        absolute paths, links), and a description that the folder only links to.
      within: a folder of which meshes, textures and includes may be read too, as of the root: where
        several assets share them.

    Returns:
      The object in metres (``scale`` 1, not normalised) in the description's world frame (SINGAPO's
      and NAP's turned to z up, front -x), shown at
      joint coordinate 0 where the limits allow. Parts are the links that have a mesh.
      ``provenance`` holds one line for each repair. ``from_voxels`` is what ``report.json`` beside
      one of our own files says.

    Raises:
      FileNotFoundError: no such file. ValueError: it cannot be read as one tree of parts; one line
        that names the file, the link or joint, and what to do.
    """
    try:
        found = find_asset(path, allow_outside=allow_outside)
    except FileNotFoundError:
        raise
    except (ValueError, OSError) as error:  # an OSError names the path too
        raise ValueError(one_line(str(error))) from None
    try:
        data = _read(found)
        files = AssetFiles(found.parent, allow_outside, within)
        obj = make_object(READERS[kind_of(data, found)](data, found, files), files, found.stem)
        return dataclasses.replace(obj, from_voxels=_from_voxels(found, files))
    except (ValueError, OSError, RuntimeError, OverflowError, MemoryError) as error:
        why = str(error) or type(error).__name__  # MemoryError says nothing
        raise ValueError(one_line(f"{found}: {why}")) from None


def _from_voxels(found: Path, files: AssetFiles) -> bool:
    """Whether the report beside one of our own descriptions says that its surfaces were found on
    voxels; a report that cannot be read says nothing."""
    report = found.with_name(REPORT)
    if found.name not in OURS or not report.is_file() or not files.allowed(report):
        return False
    try:
        said = parse_json(_read(report), REPORT, MAX_BYTES, nan=True)
    except (ValueError, OSError):
        return False
    return isinstance(said, dict) and said.get("from_voxels") is True
