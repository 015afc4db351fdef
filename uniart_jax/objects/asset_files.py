"""The files that a description names: found without leaving the asset's folder, and loaded.

**What may be read.** An asset's root is the folder of its description. A file is read if its real
path (symbolic links followed) lies under the root, or under a folder that the caller names
(``within``: a folder of assets that share meshes), or if the caller passed
``allow_outside``; the same holds for the MTLs, textures and buffers that a mesh names.
trimesh 5 reads side files only from the mesh's own folder and drops others without a word;
PartNet-Mobility's textures lie in ``../images``, hence a resolver of our own.
"""

from __future__ import annotations

import io
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import trimesh
from PIL import Image
from trimesh.resolvers import FilePathResolver
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial, empty_material

from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.image_formats import check_format, image_formats, without_ghostscript

FORMATS = (".obj", ".stl", ".ply", ".dae", ".glb", ".gltf", ".off")
GLTF = (".glb", ".gltf")
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp")
MAX_MESH_BYTES = 256 * 2**20
MAX_FACES = 5_000_000
MAX_PIXELS = 100_000_000
# What Pillow raises on a file that is no image, a broken one, or one of absurd dimensions.
IMAGE_ERRORS = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)


class RefusedError(ValueError):
    """A file that is not read on purpose: it lies outside the asset's folder, on a network, or is
    too large."""


class AssetFiles:
    """The files of one asset.

    Attributes:
      root: its folder, which names are relative to. within: a folder above it of which all may be
        read too, or None.
      notes: side files that were missing or refused, one line each.
    """

    def __init__(self, root: Path, allow_outside: bool, within: Path | None = None):
        self.root = Path(root).resolve()
        self.within = None if within is None else Path(within).resolve()
        self.allow_outside = allow_outside
        self.notes: list[str] = []
        self.faces = 0
        self._cache: dict[Path, list[trimesh.Trimesh]] = {}

    def allowed(self, path: Path) -> bool:
        """Whether a path may be read: once symbolic links are followed, it lies under the root or
        ``within``."""
        real = path.resolve()
        inside = real.is_relative_to(self.root)
        return (
            self.allow_outside or inside or bool(self.within and real.is_relative_to(self.within))
        )

    def find(self, uri: str) -> Path:
        """The file that a description's ``filename`` means: a path relative to it, absolute,
        ``file://`` or ``package://``.

        A package's root is not known: ``package://NAME/REST`` is looked up as REST and NAME/REST
        under the asset's folder, then (``allow_outside``) beside every folder above it.

        Raises:
          RefusedError: it exists or would exist outside the asset's folder.
          FileNotFoundError: there is no such file.
          ValueError: an address on the network.
        """
        scheme, separator, rest = uri.partition("://")
        scheme, rest = (scheme.lower(), rest) if separator else ("", uri)
        if scheme not in ("", "file", "package", "model"):
            raise RefusedError(f"'{uri}' is not a file: meshes are never fetched from a network")
        package = scheme in ("package", "model")
        outside = False
        for name in dict.fromkeys([rest, unquote(rest), rest.replace("\\", "/")]):
            for candidate in self._candidates(name, package):
                if not self.allowed(candidate):
                    outside = True
                elif candidate.is_file():
                    return candidate.resolve()
        if outside:
            raise RefusedError(
                f"'{uri}' lies outside the asset's folder; allow_outside=True (--allow-outside) "
                "reads it"
            )
        hint = " (allow_outside=True, --allow-outside, looks above the folder too)"
        hint = hint if package and not self.allow_outside else ""
        raise FileNotFoundError(f"'{uri}' is missing{hint}")

    def _candidates(self, name: str, package: bool) -> list[Path]:
        if "\0" in name:
            return []
        if not package:
            return [self.root / name]
        name = name.lstrip("/")
        above = self.root.parents if self.allow_outside else ()
        return [
            folder / part
            for folder in (self.root, *above)
            for part in (name, name.partition("/")[2])
            if part
        ]

    def meshes(self, path: Path) -> list[trimesh.Trimesh]:
        """The meshes of a file in its own frame (a new list; treat the meshes as read-only).

        Raises:
          ValueError: not a mesh, empty, too large, or of an unknown format; without the file's
            name.
        """
        if path not in self._cache:
            self._cache[path] = self._load(path)
        found = self._cache[path]
        self.count_faces(sum(len(m.faces) for m in found))
        return list(found)

    def count_faces(self, number: int) -> None:
        """Add to the asset's faces.

        Raises:
          RefusedError: they are too many.
        """
        self.faces += number
        if self.faces > MAX_FACES:
            raise RefusedError(f"the asset has more than {MAX_FACES:,} faces")

    @without_ghostscript()  # trimesh opens, copies and converts textures of any format
    def _load(self, path: Path) -> list[trimesh.Trimesh]:
        kind = path.suffix.lower()
        if kind not in FORMATS:
            raise ValueError(f"format '{kind}' is not one of {', '.join(FORMATS)}")
        if path.stat().st_size > MAX_MESH_BYTES:
            raise RefusedError(f"it has more than {MAX_MESH_BYTES // 2**20} MiB")
        data = path.read_bytes()
        if kind == ".dae" and (b"<!DOCTYPE" in data.replace(b"\0", b"")):
            raise ValueError("it declares a document type (DTD, entities), which is refused")
        try:
            with np.errstate(all="ignore"):
                scene = trimesh.load_scene(
                    io.BytesIO(data),
                    file_type=kind[1:],
                    resolver=_Resolver(path, self),
                    process=False,  # which would drop NaN without a word
                )
        except Exception as error:  # every loader has its own ways to fail on a broken file
            raise ValueError(
                f"it cannot be read as {kind[1:].upper()}: {type(error).__name__}: {error}"
            ) from None
        meshes, faces, sound = [], 0, {}
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            mesh = scene.geometry[name]
            if not isinstance(mesh, trimesh.Trimesh):
                continue
            faces += len(mesh.faces)
            if faces > MAX_FACES:
                raise RefusedError(f"it has more than {MAX_FACES:,} faces")
            if name not in sound:
                sound[name] = self._sound(mesh, path)
            mesh = sound[name]
            if not np.allclose(matrix, np.eye(4)):
                mesh = mesh.copy().apply_transform(matrix)
            if len(mesh.faces) and _has_area(mesh):
                meshes.append(mesh)
            elif len(mesh.faces):
                self.note(f"mesh '{path.name}': {len(mesh.faces)} faces without area were left out")
        if not meshes:
            told = [n for n in self.notes if n.startswith(f"mesh '{path.name}': ")]
            why = "".join(f" ({n.partition(': ')[2]})" for n in told)
            raise ValueError(f"it holds no faces that have an area{why}")
        unit = _unit(scene) if kind == ".dae" else 1.0
        return [m.copy().apply_scale(unit) for m in meshes] if unit != 1 else meshes

    def _sound(self, mesh: trimesh.Trimesh, path: Path) -> trimesh.Trimesh:
        """Without faces that touch a non-finite or absent vertex; textures in memory; colours
        sRGB."""
        faces = np.asarray(mesh.faces)
        good = np.all((faces >= 0) & (faces < len(mesh.vertices)), axis=1)
        finite = np.isfinite(mesh.vertices).all(1)
        good[good] &= finite[faces[good]].all(1)
        if not (good.all() and finite.all()):
            lost = f"{np.sum(~good)} faces with non-finite or absent vertices were left out"
            unused = f"{np.sum(~finite)} non-finite vertices that no face has were ignored"
            self.note(f"mesh '{path.name}': {unused if good.all() else lost}")
            mesh = mesh.copy()
            mesh.update_faces(good)
            mesh.remove_unreferenced_vertices()
        if path.suffix.lower() not in GLTF:  # whose vertices are as they are meant
            try:
                mesh.process()
            except Exception as error:  # colours or normals that are not one a vertex
                why = f"{type(error).__name__}: {error}"
                raise ValueError(f"its vertices cannot be merged: {why}") from None
        if isinstance(mesh.visual, TextureVisuals) and _is_blank(mesh.visual.material):
            mesh.visual = ColorVisuals(mesh)
        elif isinstance(mesh.visual, TextureVisuals):
            material, fault = _checked(mesh.visual.material, path.suffix.lower())
            if fault:
                self.note(f"mesh '{path.name}': {fault}")
            uv = mesh.visual.uv
            mesh.visual = TextureVisuals(uv=None if uv is None else np.array(uv), material=material)
        return mesh

    def note(self, line: str) -> None:
        """Record a repair once."""
        if line not in self.notes:
            self.notes.append(line)

    def texture(self, uri: str) -> Image.Image | None:
        """The image that a description names as a texture; None and a note if it cannot be had."""
        try:
            image = Image.open(self.find(uri), formats=image_formats())
            _decode(image)
            return image.convert("RGB")
        except IMAGE_ERRORS as error:
            self.note(
                f"texture {error}" if f"'{uri}'" in str(error) else f"texture '{uri}': {error}"
            )
            return None


class _Resolver(FilePathResolver):
    """trimesh's resolver with the asset's root, not the mesh's folder, as its fence; it remembers
    what it could not give."""

    def __init__(self, path: Path, files: AssetFiles):
        super().__init__(str(path))
        self.files = files

    def absolute(self, name: str) -> Path:
        path = (Path(self.parent) / name.strip().replace("\\", "/")).resolve()
        if not self.files.allowed(path):
            raise ValueError(f"'{name}' lies outside the asset's folder")
        return path

    def namespaced(self, namespace: str) -> _Resolver:
        return _Resolver(Path(self.parent) / namespace / "_", self.files)

    def get(self, name: str) -> bytes:
        try:
            path = self.absolute(name)
            if path.is_file() and path.stat().st_size > MAX_MESH_BYTES:
                raise RefusedError("it is too large")
            if not path.is_file():  # a pipe would never end
                raise FileNotFoundError(name)
            data = super().get(name)
        except RefusedError:
            raise ValueError(f"'{name}' is too large") from None
        except (OSError, ValueError) as error:
            why = (
                "lies outside the asset's folder and was not read"
                if isinstance(error, ValueError)
                else "is missing"
            )
            self.files.note(f"mesh '{Path(self.clean).name}': its file '{name.strip()}' {why}")
            raise FileNotFoundError(name) from None
        if name.strip().lower().endswith(IMAGES):
            try:
                Image.open(io.BytesIO(data), formats=image_formats())
            except IMAGE_ERRORS:  # trimesh would drop it without a word
                self.files.note(
                    f"mesh '{Path(self.clean).name}': its file '{name.strip()}' is not an image "
                    "that can be read"
                )
        return data


def _has_area(mesh: trimesh.Trimesh) -> bool:
    """Whether any face of a mesh can be seen, however small the mesh is."""
    points = mesh.vertices[mesh.faces]
    size = float(np.ptp(points.reshape(-1, 3), axis=0).max())
    return size > 0 and bool(trimesh.triangles.area(points).max() > 1e-12 * size**2)


def _decode(image: Image.Image) -> None:
    check_format(image)
    if image.width * image.height > MAX_PIXELS:
        raise ValueError(f"an image of {image.width} x {image.height} pixels is too large")
    image.load()


def _checked(material, kind: str) -> tuple[PBRMaterial | SimpleMaterial, str]:
    """The material with its image decoded or, if that fails, without it; and what was wrong."""
    name = "baseColorTexture" if isinstance(material, PBRMaterial) else "image"
    image = getattr(material, name, None)
    fault = ""
    if image is not None:
        try:
            _decode(image)
        except IMAGE_ERRORS as error:
            fault, image = f"its texture cannot be read ({error})", None
    if not isinstance(material, PBRMaterial):
        return SimpleMaterial(image=image, diffuse=getattr(material, "diffuse", None)), fault
    factor = material.baseColorFactor
    if factor is not None and kind in GLTF:  # glTF's factors are linear, its textures are not
        factor = np.array(factor)
        factor[:3] = np.round(linear_to_srgb(factor[:3] / 255.0) * 255)
    return PBRMaterial(baseColorTexture=image, baseColorFactor=factor), fault


def _is_blank(material) -> bool:
    """Whether trimesh made the material up: a gray image of four pixels stands for "UVs but no
    material"."""
    blank = empty_material().image
    image = getattr(material, "image", None)
    return image is not None and image.size == blank.size and image.tobytes() == blank.tobytes()


def _unit(scene: trimesh.Scene) -> float:
    """Metres per unit of a COLLADA file, which trimesh reads but does not apply."""
    try:
        return float(trimesh.units.unit_conversion(scene.units, "meters")) if scene.units else 1.0
    except (ValueError, KeyError, AttributeError):
        return 1.0
