"""An asset's description and the files that it names, copied to a folder where an engine may open all that it finds.

Nothing outside the asset's folder is copied, so no engine ever reads there; what is missing stays missing, for the engine to say so.
"""

from __future__ import annotations

import re
from pathlib import Path

from lxml import etree

from uniart_jax.objects.mjcf_text import KEPT, SOFT, Packer, remove
from uniart_jax.objects.robot_mesh import MAX_MESH_BYTES, AssetFiles, RefusedError
from uniart_jax.objects.xml_text import parse_xml

# What shapes the physics of an MJCF; actuators would hold the joints, keyframes and sensors say nothing about it.
_PHYSICS = (*KEPT, "option", "size", "statistic", "contact", "tendon")
_SIDE_FILES = re.compile(rb"^\s*(?:mtllib|usemtl)\b.*$", re.MULTILINE)


class _Physical(Packer):
    """Keeps contacts, options and all equalities, which a reader of shapes and joints has no use for."""

    def _prune(self, root: etree._Element) -> None:
        for element in list(root):
            if element.tag not in (*_PHYSICS, *SOFT):
                root.remove(element)
        for element in list(root.iter(*SOFT)):
            remove(element)


def stage_mjcf(data: bytes, path: Path, files: AssetFiles, folder: Path) -> Path:
    """Write an MJCF, made self-contained, and its files.

    Args:
      data: the file; ``path``: where it lies.
      folder: empty; takes the copies.

    Returns:
      The staged description.

    Raises:
      ValueError: a file that is missing or broken (a ``RefusedError`` where it lies outside the asset's folder or is too large), a plugin.
    """
    packer = _Physical(files, [])
    text = packer.document(data, path, 0)[0]
    for name, content in packer.assets.items():
        (folder / name).write_bytes(content)
    staged = folder / "model.xml"
    staged.write_text(text, "utf-8")
    return staged


def stage_urdf(data: bytes, files: AssetFiles, folder: Path, *, shown: bool) -> Path:
    """Write a URDF and the meshes that it names.

    Args:
      data: the file.
      folder: empty; takes the copies.
      shown: keep what is only seen.

    Returns:
      The staged description.

    Raises:
      ValueError: not XML. RefusedError: a mesh that lies outside the asset's folder or is too large.
    """
    root = parse_xml(data, [])
    if root.tag != "robot":
        raise ValueError(f"not a URDF: its root element is <{root.tag}>, not <robot>")
    places = [c.attrib.pop("meshdir") for c in root.iter("compiler") if "meshdir" in c.attrib]
    for element in list(root.iter("texture", *(() if shown else ("visual",)))):
        remove(element)
    names: dict[Path, str] = {}
    for element in root.iter("mesh"):
        found = _find(element.get("filename") or "", places, files)
        if found is None:
            continue
        if found not in names:
            names[found] = f"{len(names)}{re.sub(r'[^.a-z0-9]', '', found.suffix.lower())}"
            _copy(found, folder / names[found])
        element.set("filename", names[found])
    staged = folder / "model.urdf"
    staged.write_bytes(etree.tostring(root, xml_declaration=True, encoding="utf-8"))
    return staged


def _find(name: str, places: list[str], files: AssetFiles) -> Path | None:
    for uri in [*(f"{place}/{name}" for place in places[-1:]), name]:
        try:
            return files.find(uri.strip())
        except FileNotFoundError:
            continue
        except RefusedError:
            if "://" in uri and uri.partition("://")[0].lower() not in ("file", "package", "model"):
                return None  # on a network: no engine would fetch it either
            raise
    return None


def _copy(source: Path, target: Path) -> None:
    if source.stat().st_size > MAX_MESH_BYTES:
        raise RefusedError(f"mesh '{source.name}': it has more than {MAX_MESH_BYTES // 2**20} MiB")
    data = source.read_bytes()
    if source.suffix.lower() == ".obj":  # its materials are files too, and no engine needs them
        data = _SIDE_FILES.sub(b"", data)
    target.write_bytes(data)
