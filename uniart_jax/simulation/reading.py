"""An asset as validation takes it: read by our own reader first, then staged for engines.

A file that cannot be read at all, or that leads outside the asset's folder, is an error; one that
can be read but is wrong is judged.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from uniart_jax.objects.asset_files import AssetFiles, RefusedError
from uniart_jax.objects.load import READERS, find_asset, kind_of
from uniart_jax.objects.names import one_line
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.robot import Robot
from uniart_jax.objects.robot_object import make_object
from uniart_jax.objects.xml_text import MAX_BYTES, parse_xml
from uniart_jax.simulation import soundness
from uniart_jax.simulation.engine import Plan
from uniart_jax.simulation.measure import check
from uniart_jax.simulation.planning import plan_asset
from uniart_jax.simulation.plausibility import plausibility
from uniart_jax.simulation.staging import stage_mjcf, stage_urdf

NO_MJCF = "PyBullet reads URDF; its MJCF reader leaves out meshes, inertia and limits"


class Description:
    """One URDF or MJCF.

    Attributes:
      path: the file.
      kind: urdf, partnet or mjcf.
      root: its XML.
      robot, obj, plan: what it says; None if our reader does not take it.
      fault: why not.

    Raises:
      ValueError: it cannot be opened, is not XML, no URDF or MJCF, or leads outside its folder; one
        line that names the file.
    """

    def __init__(self, path: Path, allow_outside: bool):
        self.path = path
        self.files = AssetFiles(path.parent, allow_outside)
        try:
            with path.open("rb") as file:
                self.data = file.read(MAX_BYTES + 1)
            self.kind = kind_of(self.data, path)
            if self.kind in ("singapo", "nap"):
                raise ValueError(
                    "no physics engine reads it: make a URDF of it with `uniart reconstruct` or "
                    "`obj.save` first"
                )
            self.root: etree._Element = parse_xml(self.data, [])
            if self.root.tag not in ("robot", "mujoco"):
                raise ValueError(
                    f"neither a URDF nor an MJCF: its root element is <{self.root.tag}>"
                )
        except (ValueError, OSError) as error:
            raise ValueError(one_line(f"{path}: {error}")) from None
        self.robot: Robot | None = None
        self.obj: ArticulatedObject | None = None
        self.plan: Plan | None = None
        self.fault = ""

    def read(self) -> None:
        """Fill ``robot``, ``obj`` and ``plan``, or ``fault``."""
        try:
            self.robot = READERS[self.kind](self.data, self.path, self.files)
            self.obj = make_object(self.robot, self.files, self.path.stem)
            self.plan = plan_asset(self.robot, self.obj)
        except (ValueError, OSError, RuntimeError, OverflowError, MemoryError) as error:
            self.fault = one_line(str(error) or type(error).__name__)
            if isinstance(error, RefusedError) or "allow_outside=True" in self.fault:
                raise ValueError(one_line(f"{self.path}: {error}")) from None

    def stage(self, engine: str, folder: Path) -> tuple[Path | None, str]:
        """(description staged for an engine in a new ``folder``, why not).

        Raises:
          ValueError: it leads outside its folder.
        """
        folder.mkdir()
        try:
            if self.kind == "mjcf":
                return stage_mjcf(self.data, self.path, self.files, folder), ""
            shown = engine == "mujoco"
            return stage_urdf(self.data, self.files, folder, shown=shown), ""
        except (ValueError, OSError) as error:
            if isinstance(error, RefusedError) or "allow_outside=True" in str(error):
                raise ValueError(one_line(f"{self.path}: {error}")) from None
            return None, one_line(str(error))

    def geometry(self) -> dict[str, dict]:
        """The checks that need no engine."""
        checks = {"finite": soundness.finite_check(self.root)}
        readable = self.obj is not None and self.robot is not None and self.plan is not None
        checks["reads"] = check(int(not readable), 0, readable, self.fault)
        if self.robot is not None:
            checks |= soundness.mesh_checks(self.robot, self.files)
        if self.obj is not None and self.robot is not None and self.plan is not None:
            moved = {link for joint in self.plan.joints for link in joint.moved}
            if self.kind != "mjcf":
                checks["inertia"] = soundness.inertial_check(self.root, moved, self.plan.rigid)
                solid = soundness.collision_check(self.robot, self.plan.rigid, moved)
                checks["collision"] = solid
            checks["gaps"] = soundness.gaps(self.obj)
        return checks

    def plausibility(self) -> dict[str, dict]:
        """Whether a person would take it for an object; empty where it cannot be read."""
        return {} if self.obj is None else plausibility(self.obj)


def descriptions(asset: str | Path, allow_outside: bool) -> dict[str, Description]:
    """Engine -> what it is given: PyBullet the URDF, MuJoCo the MJCF beside it where there is one;
    an engine that has nothing is absent.

    Raises:
      FileNotFoundError, ValueError: ``load.find_asset`` finds nothing, ``Description`` refuses.
    """
    try:
        found = find_asset(asset, allow_outside=allow_outside)
    except ValueError as error:
        raise ValueError(one_line(str(error))) from None
    first = Description(found, allow_outside)
    if first.kind == "mjcf":
        return {"mujoco": first}
    beside = found.with_name("object.xml")
    if Path(asset).is_dir() and beside.is_file():
        if not first.files.allowed(beside):
            raise ValueError(
                f"{beside}: it lies outside the asset's folder; allow_outside=True "
                "(--allow-outside) reads it"
            )
        second = Description(beside, allow_outside)
        if second.kind == "mjcf":
            return {"mujoco": second, "pybullet": first}
    return {"mujoco": first, "pybullet": first}
