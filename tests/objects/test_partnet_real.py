"""Reading real PartNet-Mobility folders, those below ``$UNIART_PARTNET_DIR``."""

from __future__ import annotations

import collections
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
from partnet_folders import WORLD
from urdf_texts import has_picture, notes

from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject


def test_real_folders():
    """Every folder below ``$UNIART_PARTNET_DIR``: no error of an unknown kind; shapes, axes and
    limits as mobility_v2.json has them.

    What is expected is worked out here from the raw files, in another way than the reader's.
    """
    place = os.environ.get("UNIART_PARTNET_DIR")
    if not place:
        pytest.skip(
            "set UNIART_PARTNET_DIR to a folder of PartNet-Mobility objects: the data set (an "
            "account at sapien.ucsd.edu), or tests/testdata of "
            "github.com/r-pad/partnet_mobility_utils, which holds two"
        )
    folders = sorted(p.parent for p in Path(place).rglob("mobility_v2.json"))
    assert folders, f"{place} holds no mobility_v2.json"
    seen: collections.Counter[str] = collections.Counter()
    for folder in folders:
        if not (folder / "mobility.urdf").is_file():
            seen["no mobility.urdf"] += 1
            continue
        try:
            obj = load_object(folder)
        except (ValueError, FileNotFoundError) as error:
            assert "\n" not in str(error)
            kind = str(error).rpartition("mobility.urdf: ")[2].partition("'")[0]
            seen[f"error: {kind.strip()}"] += 1
            continue
        seen["objects"] += 1
        _compare(folder, obj, seen)
    for what, count in seen.most_common():
        print(f"{count:6d}  {what}")
    assert seen["objects"] and seen["parts compared"]
    # Hosts have pushed, turned and scaled some; a reader that puts parts elsewhere would move most
    # of them.
    assert seen["parts that a host moved"] <= 0.05 * seen["parts compared"] + 1


def _compare(folder: Path, obj: ArticulatedObject, seen: collections.Counter) -> None:
    nodes = [
        n for n in json.loads((folder / "mobility_v2.json").read_text()) if n["joint"] != "junk"
    ]
    names = {p.name: p for p in obj.parts}
    links = {n["id"]: f"link_{k}" for k, n in enumerate(nodes)}
    urdf = re.sub("<!--.*?-->", "", (folder / "mobility.urdf").read_text(), flags=re.DOTALL)
    for node in nodes:
        part = names.get(links[node["id"]])
        body = urdf.partition(f'<link name="{links[node["id"]]}">')[2].partition("</link>")[0]
        body = "".join(v.partition("</visual>")[0] for v in body.split("<visual")[1:])
        files = [f.partition('"')[0] for f in body.split('filename="')[1:]]
        files = [folder / f for f in files if (folder / f).is_file()]
        if part is None or not files:
            seen["parts without a link or mesh"] += 1
            continue
        textured = any(_has_texture(f, folder.resolve()) for f in files)
        assert not textured or has_picture(part), (folder, part.name)
        seen["parts with a texture"] += textured
        points = np.concatenate([_points(f) for f in files]) @ WORLD[:3, :3].T
        moved = _motion(node, obj, part)
        box = np.stack([points.min(0), points.max(0)])
        if moved is not None and not np.allclose(box, part.mesh.bounds, atol=2e-4):
            seen["parts that a host moved"] += 1
            continue
        seen["parts compared"] += 1
        if moved is None:
            seen["parts shown elsewhere than at 0"] += 1
            continue
        _compare_joint(node, part, moved, obj, seen, (folder, part.name))


def _motion(node: dict, obj: ArticulatedObject, part) -> tuple[float, float] | None:
    """(lo, hi) of a hinge or slider as its JSON has it; (0, 0) of other parts; None where 0 is
    excluded and the part moved."""
    data = node["jointData"]
    above = part
    while above.parent >= 0:
        joint = above.name.replace("link", "joint")
        if notes(obj, f"'{joint}': its limits") or notes(obj, f"'{joint}_helper': its limits"):
            return None
        above = obj.parts[above.parent]
    if node["joint"] not in ("hinge", "slider") or node["parent"] == -1:
        return 0.0, 0.0
    if data["limit"]["noLimit"]:
        return -math.inf, math.inf
    a, b = sorted((data["limit"]["a"], data["limit"]["b"]))
    if node["joint"] == "hinge":
        turn = 360 * (round((a + b) / 720) if not a <= 0 <= b else 0)
        a, b = math.radians(a - turn), math.radians(b - turn)
    return a, b


def _compare_joint(node, part, limits, obj, seen, where) -> None:
    joint, (lo, hi) = part.joint, limits
    if joint.type == "fixed":
        small = math.radians(0.1) if node["joint"] == "hinge" else joint.dead_zone
        assert hi - lo <= small or part.parent < 0, where
        seen["fixed, or less than the dead zone"] += 1
        return
    axis = node["jointData"]["axis"]
    direction = WORLD[:3, :3] @ axis["direction"]
    direction = direction / np.linalg.norm(direction)
    sign = np.sign(direction @ joint.direction)
    np.testing.assert_allclose(sign * direction, joint.direction, atol=1e-6, err_msg=str(where))
    offset = joint.origin - WORLD[:3, :3] @ axis["origin"]
    limit = node["jointData"]["limit"]
    if joint.rotates:
        line = offset - (offset @ direction) * direction
        np.testing.assert_allclose(line, 0, atol=1e-6, err_msg=str(where))
    got = joint.angle if node["joint"] == "hinge" else joint.travel
    if node["joint"] == "slider" and limit.get("rotates"):
        seen["sliders that rotate"] += 1
        if limit["noRotationLimit"]:
            assert joint.type == "continuous", where
            return
    if math.isinf(hi):
        assert joint.type == "continuous" or node["joint"] == "slider", where
        seen["endless"] += 1
        return
    if node["joint"] == "hinge" and hi - lo >= 2 * math.pi - 1e-6:
        assert joint.type == "continuous", where
    else:
        expected = np.sort([sign * lo, sign * hi])
        np.testing.assert_allclose(got, expected, atol=1e-6, err_msg=str(where))
    seen[f"{node['joint']}s with equal axis and limits"] += 1


def _points(path: Path) -> np.ndarray:
    """[n, 3] vertices that an OBJ's faces touch."""
    lines = path.read_text(errors="replace").splitlines()
    points = np.array([[float(t) for t in s.split()[1:4]] for s in lines if s.startswith("v ")])
    used = {int(t.split("/")[0]) for s in lines if s.startswith("f ") for t in s.split()[1:]}
    return points[[i - 1 if i > 0 else i for i in used]]


def _has_texture(path: Path, root: Path) -> bool:
    """Whether faces of an OBJ use a material whose picture is in the asset's folder."""
    lines = path.read_text(errors="replace").splitlines()
    if not any(s.startswith("vt ") for s in lines):
        return False
    used = {s.split(maxsplit=1)[1].strip() for s in lines if s.startswith("usemtl ")}
    material = ""
    for library in (s.split(maxsplit=1)[1].strip() for s in lines if s.startswith("mtllib ")):
        if not (path.parent / library).is_file():
            continue
        for line in (path.parent / library).read_text(errors="replace").splitlines():
            words = line.split()
            if words[:1] == ["newmtl"]:
                material = line.split(maxsplit=1)[1].strip()
            elif words[:1] == ["map_Kd"] and material in used:
                picture = (path.parent / words[-1]).resolve()
                if picture.is_relative_to(root) and picture.is_file():
                    return True
    return False
