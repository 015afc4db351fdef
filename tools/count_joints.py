"""Whether joints are lost on the way:  python tools/count_joints.py ROOT

Of every MJCF and URDF below ROOT: its joints (hinge and slide; revolute, continuous, prismatic),
how many of them `load_object` reads (a screw is two: it turns and travels) and how many stand in
the `object.xml` that is written of that. Then the sums. A file that cannot be read or written has
none.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from pathlib import Path

import mujoco

from uniart_jax.data.sources import find_entries
from uniart_jax.export.asset import save_asset
from uniart_jax.export.frames import moves
from uniart_jax.objects.load import find_asset, load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.xml_text import parse_xml

URDF = ("revolute", "continuous", "prismatic")
MJCF = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclasses.dataclass(frozen=True)
class Joints:
    """Of one file: as it has them, read, and written again; ``why`` it is not read or written."""

    there: int
    read: int = 0
    written: int = 0
    why: str = ""


def in_file(path: Path) -> int:
    """Movable joints of a URDF, hinges and slides of an MJCF with all that it includes."""
    root = parse_xml(path.read_bytes(), [])
    if root.tag != "mujoco":
        return sum(joint.get("type") in URDF for joint in root.iterfind("joint"))
    spec = mujoco.MjSpec.from_file(str(path))
    return sum(joint.type in MJCF for joint in spec.joints)


def in_object(obj: ArticulatedObject) -> int:
    """Of all parts, several of one part and both of a screw among them."""
    chains = [joint for part in obj.parts if moves(part) for joint in part.chain]
    return sum(int(joint.rotates) + int(joint.travels) for joint in chains)


def count(path: Path) -> Joints:
    """Of a file, or of the description that a folder holds."""
    found = find_asset(path, allow_outside=True)
    there = read = 0
    try:
        there = in_file(found)
        obj = load_object(found, allow_outside=True)
        read = in_object(obj)
        with tempfile.TemporaryDirectory() as folder:
            # one hull a part, which is quick: shapes are not looked at
            wanted = {"formats": ("mjcf",), "collision": "hull", "motion": False}
            asset = save_asset(obj, Path(folder) / "asset", **wanted)
            return Joints(there, read, in_file(asset / "object.xml"))
    except ValueError as error:
        return Joints(there, read, why=str(error))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path, help="a folder of URDFs and MJCFs")
    options = parser.parse_args()
    found = []
    for entry in find_entries(options.root, "urdf"):
        if find_asset(options.root / entry.path, allow_outside=True).suffix == ".json":
            continue
        joints = count(options.root / entry.path)
        found.append(joints)
        why = f" ({joints.why})" if joints.why else ""
        told = f"{joints.there} joints, {joints.read} read, {joints.written} written"
        print(f"{entry.path}: {told}{why}", flush=True)
    jointed = [joints for joints in found if joints.there or joints.why]
    kept = [joints for joints in jointed if min(joints.read, joints.written) >= joints.there]
    there, read, written = (
        sum(getattr(joints, key) for joints in found) for key in ("there", "read", "written")
    )
    print(
        f"{len(found)} files, {len(jointed)} of them with joints or not read, "
        f"{sum(not joints.why for joints in jointed)} of these read and written; "
        f"in {len(kept)} no joint is lost; {there} joints, {read} read, {written} written"
    )


if __name__ == "__main__":
    main()
