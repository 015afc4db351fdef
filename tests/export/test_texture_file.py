"""Textures that are worth it are JPEG in a GLB and a USDZ; a folder of five parts keeps small."""

from __future__ import annotations

import dataclasses
import io
import json
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from uniart_jax import procedural
from uniart_jax.export.asset import save_asset
from uniart_jax.export.texture_file import smaller
from uniart_jax.objects.object import ArticulatedObject

MOST = 4_000_000  # bytes of a folder of five parts


def picture(side: int = 256) -> np.ndarray:
    """[side, side, 3] colours that change everywhere, as a photograph's do."""
    rng = np.random.default_rng(0)
    coarse = Image.fromarray(rng.integers(60, 200, (side // 16, side // 16, 3), np.uint8))
    smooth = np.asarray(coarse.resize((side, side), Image.Resampling.BICUBIC), np.float64)
    return np.clip(smooth + rng.normal(0, 3, smooth.shape), 0, 255).astype(np.uint8)


def png(pixels: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    return data.getvalue()


def test_a_photograph_is_jpeg_and_plain_colours_are_not():
    given = picture()
    packed = smaller(png(given))
    assert packed is not None and len(packed) < 0.6 * len(png(given))
    found = np.asarray(Image.open(io.BytesIO(packed)), np.float64)
    assert np.abs(found - given).mean() < 3
    assert smaller(png(np.full((256, 256, 3), 90, np.uint8))) is None
    assert smaller(png(np.dstack([given, given[..., 0]]))) is None  # JPEG has no alpha


def five_parts(dense: bool) -> ArticulatedObject:
    """A dishwasher as it is drawn, or with as many faces and colours as what a network makes."""
    obj = procedural.generate("dishwasher", procedural.HELD_OUT_SEED + 10)
    assert len(obj.parts) == 5
    if not dense:
        return obj
    meshes = [part.mesh for part in obj.parts]
    while sum(len(mesh.faces) for mesh in meshes) < 9_000:
        largest = max(range(5), key=lambda k: meshes[k].area / len(meshes[k].faces))
        mesh = meshes[largest]
        meshes[largest] = trimesh.Trimesh(
            *trimesh.remesh.subdivide(mesh.vertices, mesh.faces), process=False
        )
    rng = np.random.default_rng(0)
    parts = []
    for part, mesh in zip(obj.parts, meshes, strict=True):
        colors = rng.integers(120, 140, (len(mesh.vertices), 3)).astype(np.uint8)
        bumpy = mesh.vertices + rng.normal(0, 1e-3, mesh.vertices.shape)
        made = trimesh.Trimesh(bumpy, mesh.faces, vertex_colors=colors, process=False)
        parts.append(dataclasses.replace(part, mesh=made))
    return dataclasses.replace(obj, parts=tuple(parts), from_voxels=True)


@pytest.mark.slow
@pytest.mark.parametrize("dense", [False, True])
def test_a_folder_of_five_parts_is_small(tmp_path, dense):
    """With every format that is written by default."""
    out = save_asset(five_parts(dense), tmp_path / "a")
    sizes = {p.relative_to(out): p.stat().st_size for p in out.rglob("*") if p.is_file()}
    assert sum(sizes.values()) <= MOST, sizes
    length, _ = struct.unpack("<II", (out / "object.glb").read_bytes()[12:20])
    tree = json.loads((out / "object.glb").read_bytes()[20 : 20 + length])
    assert tree["images"][0]["mimeType"] == ("image/jpeg" if dense else "image/png")
    scene = trimesh.load(out / "object.glb")
    shown = next(iter(scene.geometry.values())).visual.material.baseColorTexture
    with Image.open(out / "meshes" / "texture.png") as whole:
        assert shown.size == whole.size
        off = np.abs(np.asarray(shown, float) - np.asarray(whole, float)).mean()
        assert off < 2


@pytest.mark.slow
def test_a_package_holds_its_smaller_texture(tmp_path):
    pytest.importorskip("pxr", reason="pip install 'uniart_jax[usd]'")
    from pxr import Sdf, Usd, UsdShade, UsdUtils

    out = save_asset(five_parts(True), tmp_path / "a", formats=("usd",), motion=False)
    package = str(out / "object.usdz")
    layers, assets, missing = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(package))
    assert not missing and len(layers) == 1
    assert [str(a).rpartition("[")[2].rstrip("]") for a in assets] == ["meshes/texture.jpg"]
    for file, name in (("object.usdz", "texture.jpg"), ("object.usda", "texture.png")):
        stage = Usd.Stage.Open(str(out / file))
        shaders = [UsdShade.Shader(p) for p in stage.Traverse() if p.IsA(UsdShade.Shader)]
        files = [s.GetInput("file") for s in shaders if s.GetIdAttr().Get() == "UsdUVTexture"]
        assert [f.Get().resolvedPath.rstrip("]").endswith(name) for f in files] == [True]
