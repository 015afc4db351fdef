"""An MJCF and all files that it names as one text and a table of bytes, so that MuJoCo's parser
never opens a file.

``<include>`` is put in place, every ``file`` attribute is looked up here, inside the asset's
folder, and becomes a name in the table; ``compiler``'s ``meshdir``, ``texturedir``, ``assetdir``
and ``strippath`` are applied on the way (MuJoCo's XML reference, "compiler", "include", "asset").
Only what makes shapes and joints is kept: sensors, actuators, contacts and keyframes neither matter
nor can fail.
"""

from __future__ import annotations

import dataclasses
import io
import re
from collections.abc import Callable
from pathlib import Path

from lxml import etree
from PIL import Image

from uniart_jax.objects.asset_files import (
    IMAGE_ERRORS,
    MAX_MESH_BYTES,
    MAX_PIXELS,
    AssetFiles,
    RefusedError,
)
from uniart_jax.objects.image_formats import image_formats
from uniart_jax.objects.xml_text import MAX_BYTES, parse_xml

MAX_MODELS = 4  # models attached within models
MAX_DOCUMENTS = 256  # included or attached
MAX_TEXT_BYTES = 4 * MAX_BYTES  # of all of them
MAX_ALL_PIXELS = 4 * MAX_PIXELS  # of all textures and height fields
# with what <replicate> and <attach> multiply; MuJoCo takes seconds for 5,000 bodies, and four times
# as long for twice as many
MAX_ELEMENTS = 10_000
MAX_PARAMETER = 1000  # resolution of a built-in mesh
KEPT = ("compiler", "default", "asset", "worldbody", "equality")
SOFT = ("composite", "flexcomp", "deformable", "skin")
_PLACES = ("meshdir", "texturedir", "assetdir", "strippath", "discardvisual", "fusestatic")
_SIZES = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_PNG = b"\x89PNG\r\n\x1a\n"
_FOLDER = {"mesh": "meshdir", "hfield": "meshdir", "texture": "texturedir"}


def self_contained(
    data: bytes, path: Path, files: AssetFiles, notes: list[str]
) -> tuple[str, dict[str, bytes]]:
    """(text, name -> bytes of every file that the text names).

    Args:
      data: the MJCF.
      path: where it lies; other files are named relative to its folder.
      files: which of them may be read.
      notes: takes up what is left out.

    Raises:
      ValueError: what ``parse_xml`` refuses, a plugin, a file that is missing, too large or outside
        the asset's folder, includes or attachments without end; one line that names element and
        file.
    """
    packer = Packer(files, notes)
    return packer.document(data, path, 0)[0], packer.assets


@dataclasses.dataclass(frozen=True)
class _Packed:
    """A file in the table, and what MuJoCo makes of it each time that it is named.

    Attributes:
      name: in the table.
      pixels: of its image; of a model, of all its textures.
      elements: of a model, with what it attaches.
      height: of a model, levels of models within it, itself included.
    """

    name: str = ""
    pixels: int = 0
    elements: int = 0
    height: int = 0


class Packer:
    def __init__(self, files: AssetFiles, notes: list[str]):
        self.files = files
        self.notes = notes
        self.assets: dict[str, bytes] = {}
        self.known: dict[tuple[Path, str], _Packed] = {}
        self.documents = self.text_bytes = 0

    def document(self, data: bytes, path: Path, depth: int) -> tuple[str, _Packed]:
        """(text, what it costs) of a model."""
        root = self._parsed(data)
        if root.tag != "mujoco":
            raise ValueError(f"not an MJCF: its root element is <{root.tag}>, not <mujoco>")
        self._include(root, path.parent, path.parent, {path.resolve()})
        for element in root.iter("plugin", "extension"):
            raise ValueError(f"<{element.tag}> (line {element.sourceline}): plugins are never run")
        places = _pop_places(root)
        self._prune(root)
        pixels = _checked_sizes(root)
        elements = dict.fromkeys(pixels, 1)
        models: dict[str, list[_Packed]] = {}
        for element in list(root.iter()):
            if any(str(name).startswith("file") for name in element.attrib):
                packed = self._pack(element, path.parent, places, depth)
                pixels[element] = pixels.get(element, 0) + packed.pixels
                elements[element] = 1 + packed.elements  # a model is read each time it is named
                if element.tag == "model":
                    models.setdefault(element.get("name") or "", []).append(packed)
        attached = {name: max(m.elements for m in found) for name, found in models.items()}
        count = _total(root, attached, lambda e: elements.get(e, 1))
        if count > MAX_ELEMENTS:
            raise RefusedError(
                f"{count:,} elements, counted as often as <replicate> and <attach> repeat them, "
                f"are more than {MAX_ELEMENTS:,}"
            )
        attached = {name: max(m.pixels for m in found) for name, found in models.items()}
        seen = _total(root, attached, lambda e: pixels.get(e, 0))
        if seen > MAX_ALL_PIXELS:
            raise RefusedError(
                f"{seen:,} pixels of textures and height fields are more than {MAX_ALL_PIXELS:,}"
            )
        height = 1 + max((m.height for found in models.values() for m in found), default=0)
        return etree.tostring(root, encoding="unicode"), _Packed("", seen, count, height)

    def _parsed(self, data: bytes) -> etree._Element:
        self.documents += 1
        self.text_bytes += len(data)
        if self.documents > MAX_DOCUMENTS or self.text_bytes > MAX_TEXT_BYTES:
            raise RefusedError(
                f"more than {MAX_DOCUMENTS} included and attached files, or "
                f"{MAX_TEXT_BYTES // 2**20} MiB of them"
            )
        return parse_xml(data, self.notes)

    def _include(self, root: etree._Element, main: Path, own: Path, seen: set[Path]) -> None:
        """Put what ``<include>`` names in its place; MuJoCo too takes each file once."""
        for element in list(root.iter("include")):
            name = element.get("file") or ""
            parent = element.getparent()
            if parent is None or not name:
                raise ValueError(f"an <include> in line {element.sourceline} names no file")
            where = f"<include file='{name}'>"
            # relative to the model that is read, as MuJoCo has it, else to the file that includes
            path = next(
                (p for f in (main, own) if (p := f / name).is_file() and self.files.allowed(p)),
                main / name,
            )
            data = self._read(path, where, MAX_BYTES)
            if path.resolve() in seen:
                raise ValueError(f"{where}: the file is included twice")
            seen.add(path.resolve())
            try:
                included = self._parsed(data)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from None
            self._include(included, main, path.parent, seen)
            at = parent.index(element)
            parent[at : at + 1] = list(included)

    def _read(self, path: Path, where: str, limit: int) -> bytes:
        if not self.files.allowed(path):
            raise RefusedError(
                f"{where}: it lies outside the asset's folder; allow_outside=True "
                "(--allow-outside) reads it"
            )
        if not path.is_file():
            raise ValueError(f"{where}: the file is missing")
        if path.stat().st_size > limit:
            raise RefusedError(f"{where}: it has more than {limit // 2**20} MiB")
        return path.read_bytes()

    def _prune(self, root: etree._Element) -> None:
        for element in list(root):
            if element.tag not in (*KEPT, *SOFT):
                root.remove(element)
        for element in list(root.iter(*SOFT)):
            self.notes.append(f"link: a soft body (<{element.tag}>) was left out")
            remove(element)
        for equality in root.findall("equality"):
            for element in list(equality):
                if element.tag != "joint":
                    name = element.get("name") or ""
                    self.notes.append(f"equality <{element.tag}> '{name}': not represented")
                    equality.remove(element)

    def _pack(
        self,
        element: etree._Element,
        folder: Path,
        places: dict[str, str],
        depth: int,
    ) -> _Packed:
        """Put what an element names into the table; its file, or of several (a cube's sides) the
        pixels of all."""
        packed = _Packed()
        for attribute in [str(a) for a in element.attrib if str(a).startswith("file")]:
            name = (element.get(attribute) or "").strip()
            if not name:
                del element.attrib[attribute]
                continue
            where = f"<{element.tag} {attribute}='{name}'>"
            if element.tag not in (*_FOLDER, "model"):
                raise ValueError(f"{where}: this element cannot name a file")
            name = name.replace("\\", "/")
            if places.get("strippath") == "true":
                name = name.rpartition("/")[2]
            path = folder / places.get(_FOLDER.get(element.tag, ""), "") / name
            if element.tag != "model" and attribute == "file" and not element.get("name"):
                element.set("name", Path(name).stem)  # MuJoCo names it after its file
            found = self._packed(path, element.tag, where, depth)
            element.set(attribute, found.name)
            sides = 6 if element.get("gridsize") else 1  # one side's picture may be asked for six
            packed = dataclasses.replace(found, pixels=packed.pixels + sides * found.pixels)
        return packed

    def _packed(self, path: Path, tag: str, where: str, depth: int) -> _Packed:
        """A file in the table, read once; textures are looked at, models are packed in turn."""
        key = (path.resolve(), tag)
        known = self.known.get(key)
        if known is None:
            data = self._read(path, where, MAX_BYTES if tag == "model" else MAX_MESH_BYTES)
            suffix, known = re.sub(r"[^.a-z0-9]", "", path.suffix.lower()), _Packed()
            if tag == "model":
                if depth + 1 > MAX_MODELS:
                    raise RefusedError(f"{where}: models within models within models")
                try:
                    text, known = self.document(data, path, depth + 1)
                except ValueError as error:
                    raise ValueError(f"{where}: {error}") from None
                data, suffix = text.encode(), ".xml"
            elif tag in ("texture", "hfield") and (suffix == ".png" or data.startswith(_PNG)):
                known = _Packed(pixels=_checked_image(data, where))
            known = dataclasses.replace(known, name=f"{len(self.assets)}{suffix}")
            self.known[key], self.assets[known.name] = known, data
        if depth + known.height > MAX_MODELS:
            raise RefusedError(f"{where}: models within models within models")
        return known


def _pop_places(root: etree._Element) -> dict[str, str]:
    """Where ``compiler`` says files lie; later ones win. What would drop or fuse bodies is taken
    out with it."""
    places: dict[str, str] = {}
    for compiler in root.iter("compiler"):
        found = {p: compiler.attrib.pop(p) for p in _PLACES if p in compiler.attrib}
        if "assetdir" in found:
            places |= {"meshdir": found["assetdir"], "texturedir": found["assetdir"]}
        places |= found
    return {name: text.strip().replace("\\", "/") for name, text in places.items()}


def remove(element: etree._Element) -> None:
    parent = element.getparent()
    if parent is not None:
        parent.remove(element)


def _numbers(element: etree._Element, *names: str) -> list[float]:
    """All numbers of these attributes; what is none is left to MuJoCo's own error."""
    found = []
    for text in " ".join(element.get(n) or "" for n in names).split():
        try:
            found.append(float(text))
        except ValueError:
            continue
    return found


def _checked_sizes(root: etree._Element) -> dict[etree._Element, int]:
    """Pixels of every texture and height field that MuJoCo makes itself; what would take more
    memory than a file of its size may is refused."""
    for element in root.iter("mesh"):
        if not all(abs(p) <= MAX_PARAMETER for p in _numbers(element, "params")):
            raise RefusedError(f"<mesh name='{element.get('name') or ''}'>: it is too large")
    return {element: _pixels(element) for element in root.iter(*_SIZES)}


def _pixels(element: etree._Element) -> int:
    first, second = (max(_numbers(element, n), default=0.0) for n in _SIZES[element.tag])
    if element.tag == "texture" and element.get("type") != "2d":
        pixels = 6 * first**2  # a cube: MuJoCo takes the width for its height, whatever that says
    else:
        pixels = first * second * (1 if element.tag == "texture" else 6)
    pixels *= max([3.0, *_numbers(element, "nchannel")]) / 3
    if not (0 <= first <= MAX_PIXELS and 0 <= second <= MAX_PIXELS and pixels <= MAX_PIXELS):
        raise RefusedError(f"<{element.tag} name='{element.get('name') or ''}'>: it is too large")
    return int(pixels)


def _checked_image(data: bytes, where: str) -> int:
    """The number of an image's pixels."""
    try:
        image = Image.open(io.BytesIO(data), formats=image_formats())
    except IMAGE_ERRORS as error:
        raise ValueError(f"{where}: not an image that can be read ({error})") from None
    if image.width * image.height > MAX_PIXELS:
        raise RefusedError(f"{where}: {image.width} x {image.height} pixels are too many")
    return image.width * image.height


def _total(
    element: etree._Element, models: dict[str, int], own: Callable[[etree._Element], int]
) -> int:
    """The sum of ``own`` over a tree as MuJoCo builds it: repeated where it is replicated, with the
    models that it attaches."""
    inside = own(element) + sum(_total(child, models, own) for child in element)
    if element.tag == "replicate":
        inside *= max(1, *(int(min(n, 1e12)) for n in [0.0, *_numbers(element, "count")]))
    if element.tag == "attach":  # a model without a name goes by one that stands in its own file
        inside += models.get(element.get("model") or "", max(models.values(), default=0))
    return inside
