"""How a joint of a USD file stands, ends and resists. Needs usd-core, which is imported only when
called."""

from __future__ import annotations

import numpy as np
from trimesh.transformations import quaternion_from_matrix

from uniart_jax.export.physics import Dynamics
from uniart_jax.export.usd_shapes import quaternion, vector


def place_joint(joint, at: np.ndarray, direction: np.ndarray | None) -> None:
    """Put a joint at ``at`` [3] in its first body and at the origin of its second; its axis, X in
    the joint's frame, is ``direction`` [3] in both."""
    turn = np.eye(4)
    if direction is not None:
        joint.CreateAxisAttr("X")
        turn[:3, :3] = _frame_of(direction)
    rotation = quaternion(quaternion_from_matrix(turn))
    joint.CreateLocalPos0Attr(vector(at))
    joint.CreateLocalRot0Attr(rotation)
    joint.CreateLocalPos1Attr(vector(np.zeros(3)))
    joint.CreateLocalRot1Attr(rotation)


def _frame_of(direction: np.ndarray) -> np.ndarray:
    """[3, 3] rotation whose first column is ``direction``; the identity for x."""
    side = np.eye(3)[1 if abs(direction[1]) < 0.9 else 2]
    last = np.cross(direction, side)
    last /= np.linalg.norm(last)
    return np.stack([direction, np.cross(last, direction), last], 1)


def set_limits(joint, limits) -> None:
    """(lower, upper) in degrees or metres."""
    joint.CreateLowerLimitAttr(float(limits[0]))
    joint.CreateUpperLimitAttr(float(limits[1]))


def set_dynamics(joint, dynamics: Dynamics, kind: str) -> None:
    """Damping, effort and the spring as a UsdPhysics drive; dry friction and velocity, which
    UsdPhysics lacks, as PhysX's schemas.

    Args:
      kind: 'angular' (then UsdPhysics and PhysX count in degrees; torques stay N m) or 'linear'.
    """
    from pxr import Sdf, UsdPhysics

    degree = np.deg2rad(1.0) if kind == "angular" else 1.0
    drive = UsdPhysics.DriveAPI.Apply(joint.GetPrim(), kind)
    drive.CreateTypeAttr("force")
    drive.CreateStiffnessAttr(dynamics.stiffness * degree)
    if dynamics.stiffness > 0:
        drive.CreateTargetPositionAttr(dynamics.reference / degree)
    drive.CreateDampingAttr(dynamics.damping * degree)
    drive.CreateMaxForceAttr(dynamics.effort)
    prim = joint.GetPrim()
    prim.AddAppliedSchema("PhysxJointAPI")
    prim.AddAppliedSchema(f"PhysxJointAxisAPI:{kind}")
    values = {
        "physxJoint:maxJointVelocity": dynamics.velocity / degree,
        f"physxJointAxis:{kind}:maxJointVelocity": dynamics.velocity / degree,
        f"physxJointAxis:{kind}:staticFrictionEffort": dynamics.friction,
        f"physxJointAxis:{kind}:dynamicFrictionEffort": dynamics.friction,
    }
    for name, value in values.items():
        attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Float, custom=False)
        attribute.Set(float(value))
