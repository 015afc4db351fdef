"""Real files, made by others: forward kinematics against the program that each was made for, and
broken files.

The files are not in this repository: give a folder of URDFs and MJCFs as $UNIART_REAL_DIR, one of
broken ones as $UNIART_MALFORMED_DIR.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from engines import compared, mujoco_engine, mujoco_misplaced, urdf_engine
from trimesh import transform_points
from urdf_texts import link, mesh, robot

from uniart_jax.objects.appearance import sample_color
from uniart_jax.objects.asset_files import AssetFiles
from uniart_jax.objects.load import kind_of, load_object
from uniart_jax.objects.robot_mesh import link_mesh
from uniart_jax.objects.urdf_read import read_robot

BESIDE = Path(__file__).resolve().parents[2].parent / "shared"
TOLERANCE = 1e-6  # of the object's size
REFUSED = {"hinge.urdf": "is spherical"}


def folder(variable: str, name: str) -> Path | None:
    path = Path(os.environ.get(variable) or BESIDE / name)
    return path if path.is_dir() else None


REAL, MALFORMED = folder("UNIART_REAL_DIR", "real"), folder("UNIART_MALFORMED_DIR", "malformed")
needs_malformed = pytest.mark.skipif(
    MALFORMED is None, reason="set UNIART_MALFORMED_DIR to a folder of broken URDFs and meshes"
)


def real_files() -> list:
    """Every description under the folder; or one that is skipped and says what to give."""
    if REAL is None:
        skip = pytest.mark.skip(reason="set UNIART_REAL_DIR to a folder of URDFs and MJCFs")
        return [pytest.param(Path("none"), marks=skip)]
    found = sorted(REAL.rglob("*.urdf"))
    found += [p for p in sorted(REAL.rglob("*.xml")) if kind_of(p.read_bytes(), p) == "mjcf"]
    return [pytest.param(p, id=str(p.relative_to(REAL))) for p in found]


@pytest.mark.parametrize("path", real_files())
def test_a_real_file_moves_as_in_its_own_program(path, record_property):
    is_mjcf = path.suffix == ".xml"
    if path.name in REFUSED:
        with pytest.raises(ValueError, match=REFUSED[path.name]):
            load_object(path, allow_outside=True)
        return
    try:
        engine = mujoco_engine(path) if is_mjcf else urdf_engine(path)
    except Exception as error:  # every engine has its own ways to refuse
        if not os.environ.get("UNIART_REAL_DIR"):  # of the files that we know, it refuses none
            raise
        pytest.skip(f"its own program cannot load it: {type(error).__name__}")
    obj = load_object(path, allow_outside=True)
    assert len(obj.provenance) == len(set(obj.provenance))
    result = compared(obj, engine, seed=0)
    for name in ("error", "compared", "excepted", "held"):
        record_property(name, getattr(result, name))
    assert result.error <= TOLERANCE and not result.wrong and not result.unexplained
    # an object is placed where its program shows it
    size = float((obj.bounds[1] - obj.bounds[0]).max())
    if is_mjcf:
        assert mujoco_misplaced(obj, path, engine.shown) <= TOLERANCE * size
    else:
        frames, files = engine.frames(engine.shown), AssetFiles(path.parent, True)
        links = read_robot(path.read_bytes()).links
        for part in obj.parts:
            own = link_mesh(links[part.name], files, [])
            assert own is not None
            there = transform_points(own.vertices, frames[part.name])
            assert np.abs(there - part.mesh.vertices).max() <= TOLERANCE * size


@pytest.mark.parametrize("path", real_files())
def test_a_real_file_is_an_object_or_one_line_that_allow_outside_answers(path):
    try:
        obj = load_object(path)
    except ValueError as error:
        words = REFUSED.get(path.name, "allow_outside=True")
        assert words in str(error) and "\n" not in str(error)
    else:
        moved = obj.normalized()
        assert np.isfinite(moved.bounds).all()
        moved.forward_kinematics(moved.open())


@needs_malformed
def test_every_malformed_file_is_an_object_or_one_line(tmp_path):
    assert MALFORMED is not None
    found = [p for p in sorted(MALFORMED.rglob("*")) if p.is_file()]
    assert found
    for file in found:
        path, named = file, "link '"
        if file.suffix.lower() not in (".urdf", ".xml", ".json"):
            path, named = tmp_path / "a.urdf", file.name
            shutil.copy(file, tmp_path / file.name)
            path.write_text(robot(link("base", mesh(file.name))))
        try:
            obj = load_object(path)
        except (ValueError, FileNotFoundError) as error:
            assert named in str(error) and path.name in str(error) and "\n" not in str(error)
        else:
            for part in obj.parts:
                faces = np.arange(len(part.mesh.faces))
                color = sample_color(part.mesh, faces, np.full((len(faces), 3), 1 / 3))
                assert np.isfinite(color).all() and np.isfinite(part.mesh.vertices).all()
