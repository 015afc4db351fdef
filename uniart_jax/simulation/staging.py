"""An asset's description and the files that it names, copied to a folder where an engine may open
all that it finds.

Nothing outside the asset's folder is copied, and no staged file says a name that leads out of the
copy: PyBullet looks for a relative one beside every folder above, MuJoCo below ``compiler``'s
``meshdir``. What is missing stays missing, under a name that is nowhere.
"""

from __future__ import annotations

import re
from pathlib import Path

from lxml import etree

from uniart_jax.objects.asset_files import MAX_MESH_BYTES, AssetFiles, RefusedError
from uniart_jax.objects.mjcf_text import KEPT, SOFT, Packer, remove
from uniart_jax.objects.xml_text import parse_xml

# What shapes the physics of an MJCF; actuators would hold the joints, keyframes and sensors say
# nothing about it.
_PHYSICS = (*KEPT, "option", "size", "statistic", "contact", "tendon")
_PLACES = ("meshdir", "assetdir", "texturedir")  # of compiler; of the first two, the former counts
_MATERIALS = (b"mtllib", b"usemtl")


class _Physical(Packer):
    """Keeps contacts, options and all equalities, which a reader of shapes and joints has no use
    for."""

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
      ValueError: a file that is missing or broken (a ``RefusedError`` where it lies outside the
        asset's folder or is too large), a plugin.
    """
    packer = _Physical(files, [])
    text = packer.document(data, path, 0)[0]
    for name, content in packer.assets.items():
        (folder / name).write_bytes(_alone(name, content))
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
      ValueError: not XML. RefusedError: a mesh that lies outside the asset's folder or is too
        large.
    """
    root = parse_xml(data, [])
    if root.tag != "robot":
        raise ValueError(f"not a URDF: its root element is <{root.tag}>, not <robot>")
    place = _pop_place(root)
    # engines know no name spaces: they take <mesh xmlns="..."> for a mesh
    for element in list(root.iter("{*}texture", *(() if shown else ("{*}visual",)))):
        remove(element)
    names: dict[Path, str] = {}
    missing: dict[str, str] = {}
    for element in root.iter(etree.Element):
        if etree.QName(element).localname != "mesh":
            for attribute in ("filename", "file"):  # of a cdf, a deformable, a plugin
                element.attrib.pop(attribute, None)
            continue
        said = element.get("filename") or ""
        found = _find(said, place, files)
        if found is None:
            element.set("filename", missing.setdefault(said, f"missing-{len(missing)}.obj"))
            continue
        if found not in names:
            names[found] = f"{len(names)}{re.sub(r'[^.a-z0-9]', '', found.suffix.lower())}"
            _copy(found, folder / names[found])
        element.set("filename", names[found])
    staged = folder / "model.urdf"
    staged.write_bytes(etree.tostring(root, xml_declaration=True, encoding="utf-8"))
    return staged


def _pop_place(root: etree._Element) -> str:
    """Where ``compiler`` says meshes lie; later ones win. No folder is left for an engine to look
    into."""
    place = ""
    for compiler in root.iter("{*}compiler"):
        found = {p: compiler.attrib.pop(p) for p in _PLACES if p in compiler.attrib}
        place = found.get("meshdir", found.get("assetdir", place))
    return str(place).strip()


def _find(name: str, place: str, files: AssetFiles) -> Path | None:
    for uri in [*([f"{place}/{name}"] if place else []), name]:
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
    target.write_bytes(_alone(target.name, source.read_bytes()))


def _alone(name: str, data: bytes) -> bytes:
    """A mesh without its materials, which are files too and which no engine needs.

    A line ends at a carriage return as well, and PyBullet reads a long one in pieces: no line that
    says the words anywhere is kept.
    """
    if not name.endswith(".obj") or not any(word in data for word in _MATERIALS):
        return data
    lines = data.splitlines()
    return b"\n".join(x for x in lines if not any(word in x for word in _MATERIALS)) + b"\n"
