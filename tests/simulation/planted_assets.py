"""Small assets written by hand as URDF and MJCF text: sound ones, and the same with one fault
each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

Block = tuple[Sequence[float], Sequence[float]]  # centre, size
DENSITY = 300.0


def solid(blocks: Sequence[Block]) -> tuple[float, np.ndarray, np.ndarray]:
    """(kg, centre of mass, inertia about it) of blocks in a link's frame."""
    meshes = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(c))
        for c, size in blocks
    ]
    whole = trimesh.util.concatenate(meshes)
    whole.density = DENSITY
    return float(whole.mass), np.asarray(whole.center_mass), np.asarray(whole.moment_inertia)


def text(values) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def link(name: str, blocks: Sequence[Block], *, visual: str = "", shown: bool = True) -> str:
    """A link of solid blocks; ``visual`` replaces what is seen of it."""
    shape = '<{tag}><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></{tag}>'
    mass, center, tensor = solid(blocks) if blocks else (0.02, np.zeros(3), 1e-5 * np.eye(3))
    entries = " ".join(
        f'i{a}{b}="{tensor[i, j]:.9g}"'
        for a, i, b, j in [
            (a, i, b, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
        ]
    )
    body = (
        f'<inertial><origin xyz="{text(center)}"/><mass value="{mass:.9g}"/><inertia '
        f"{entries}/></inertial>"
    )
    for tag in ("visual", "collision"):
        if tag == "visual" and (visual or not shown):
            body += visual
            continue
        body += "".join(shape.format(tag=tag, at=text(c), size=text(s)) for c, s in blocks)
    return f'<link name="{name}">{body}</link>'


def joint(
    name: str, kind: str, parent: str, child: str, at, axis, limits=None, *,
    damping: float = 0.0, friction: float = 0.0, extra: str = "",
) -> str:  # fmt: skip
    limit = "" if limits is None else f'lower="{limits[0]}" upper="{limits[1]}" '
    motion = (
        ""
        if kind == "fixed"
        else (
            f'<axis xyz="{text(axis)}"/><limit {limit}effort="100" velocity="5"/><dynamics '
            f'damping="{damping}" friction="{friction}"/>'
        )
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child '
        f'link="{child}"/><origin xyz="{text(at)}"/>{motion}{extra}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<?xml version="1.0"?>\n<robot name="planted">{"".join(parts)}</robot>\n'


def write(folder: Path, urdf: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "object.urdf").write_text(urdf)
    return folder


def shell(lo, hi, wall: float) -> list[Block]:
    """Five walls of a box open towards -x, and a shelf half way up."""
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    boxes = [
        ([hi[0] - wall, lo[1], lo[2]], hi),
        (lo, [hi[0], lo[1] + wall, hi[2]]),
        ([lo[0], hi[1] - wall, lo[2]], hi),
        (lo, [hi[0], hi[1], lo[2] + wall]),
        ([lo[0], lo[1], hi[2] - wall], hi),
        ([lo[0], lo[1], (lo[2] + hi[2] - wall) / 2], [hi[0], hi[1], (lo[2] + hi[2] + wall) / 2]),
    ]
    return [((np.add(a, b) / 2).tolist(), np.subtract(b, a).tolist()) for a, b in boxes]


BODY = shell([-0.3, -0.4, -0.5], [0.3, 0.4, 0.5], 0.03)
DOOR = [
    ([-0.0175, 0.375, 0.24], [0.035, 0.75, 0.46])
]  # in the frame of its hinge, at its lower end
TRAY = [
    ([-0.29, 0, 0], [0.03, 0.72, 0.4]),
    ([-0.02, 0, -0.185], [0.5, 0.72, 0.03]),
    ([-0.02, -0.345, -0.05], [0.5, 0.03, 0.24]),
    ([-0.02, 0.345, -0.05], [0.5, 0.03, 0.24]),
]
HANDLE = [([-0.33, 0, 0], [0.05, 0.2, 0.03])]
HINGE = [-0.31, -0.375, 0]


def cabinet(
    folder: Path, *, axis=(0, 0, 1), limits=(0, 2.0), body=BODY, door=DOOR, at=HINGE, drawer=(0, 0.35),  # noqa: E501
    visual: str = "", change: tuple[str, str] = ("", ""),
) -> Path:  # fmt: skip
    """Body, hinged door above, drawer with a fixed handle below, 1 m high; ``change`` replaces one
    piece of its text."""
    urdf = robot(
        link("body", body),
        link("door", door, visual=visual),
        link("drawer", TRAY),
        link("drawer_handle", HANDLE),
        joint("door_hinge", "revolute", "body", "door", at, axis, limits, friction=0.05),
        joint("drawer_slide", "prismatic", "body", "drawer", [0, 0, -0.25], [-1, 0, 0], drawer, friction=0.5),  # noqa: E501
        joint("handle_fixed", "fixed", "drawer", "drawer_handle", [0, 0, 0], None),
    )  # fmt: skip
    assert not change[0] or change[0] in urdf
    return write(folder, urdf.replace(*change))


def pantry(folder: Path, *, locked: bool = False) -> Path:
    """A tray that slides out once the door before it is open; ``locked``: the door hardly opens."""
    tray = [([0, 0, 0], [0.5, 0.72, 0.05])]
    return write(
        folder,
        robot(
            link("body", BODY),
            link("door", DOOR),
            link("tray", tray),
            joint("door_hinge", "revolute", "body", "door", HINGE, [0, 0, 1], (0, 0.2 if locked else 2.0), friction=0.05),  # noqa: E501
            joint("tray_slide", "prismatic", "body", "tray", [0, 0, 0.2], [-1, 0, 0], (0, 0.3), friction=0.5),  # noqa: E501
        ),
    )  # fmt: skip


def corner(folder: Path) -> Path:
    """Two blocks that slide into the same corner from two sides, where there is room for one, and a
    third that slides elsewhere."""
    cube = [([0, 0, 0], [0.2, 0.2, 0.2])]
    return write(
        folder,
        robot(
            link("body", [([0, 0, -0.15], [1, 1, 0.05])]),
            *(link(name, cube) for name in ("first", "second", "third")),
            joint("first_slide", "prismatic", "body", "first", [-0.3, 0.3, 0], [1, 0, 0], (0, 0.6), friction=0.5),  # noqa: E501
            joint("second_slide", "prismatic", "body", "second", [0.3, -0.3, 0], [0, 1, 0], (0, 0.6), friction=0.5),  # noqa: E501
            joint("third_slide", "prismatic", "body", "third", [-0.3, -0.3, 0], [0, 1, 0], (0, 0.2), friction=0.5),  # noqa: E501
        ),
    )  # fmt: skip


def chest(folder: Path, *, friction: float = 8.0) -> Path:
    """A box with a lid that flips about a horizontal hinge, and a dial on the lid that rotates
    without end."""
    body = [(c, s) for c, s in shell([-0.3, -0.4, 0], [0.3, 0.4, 0.3], 0.02)[:4]]
    front = ([-0.29, 0, 0.15], [0.02, 0.8, 0.3])
    lid = [([-0.3, 0, 0.0225], [0.6, 0.8, 0.025])]
    dial = [([0, 0, 0.025], [0.12, 0.03, 0.03])]
    return write(
        folder,
        robot(
            link("box", [*body, front]),
            link("lid", lid),
            link("dial", dial),
            joint("flip", "revolute", "box", "lid", [0.3, 0, 0.3], [0, 1, 0], (0, 1.3), friction=friction),  # noqa: E501
            joint("rotate", "continuous", "lid", "dial", [-0.3, 0, 0.04], [0, 0, 1], friction=0.002),  # noqa: E501
        ),
    )  # fmt: skip


def jar(folder: Path, *, pitch: float = 0.02) -> Path:
    """A cap that turns and rises: a revolute joint, a link without shapes, and a prismatic joint
    that mimics the first."""
    return write(
        folder,
        robot(
            link("jar", [([0, 0, 0.1], [0.12, 0.12, 0.2])]),
            link("cap_turn", []),
            link("cap", [([0, 0, 0.022], [0.13, 0.13, 0.04])]),
            joint("turn", "revolute", "jar", "cap_turn", [0, 0, 0.2], [0, 0, 1], (0, 5.0), friction=0.1),  # noqa: E501
            joint(
                "rise", "prismatic", "cap_turn", "cap", [0, 0, 0], [0, 0, 1], (0, 5.0 * pitch),
                extra=f'<mimic joint="turn" multiplier="{pitch}" offset="0"/>',
            ),
        ),
    )  # fmt: skip


def slider(
    folder: Path,
    *,
    friction: float = 0.0,
    damping: float = 0.0,
    axis=(1, 0, 0),
    wall: float = 0.1,
    travel: float = 0.2,
) -> Path:
    """A block of 10 cm that slides towards a wall ``wall`` metres away; its body, with the wall, is
    a metre long."""
    return write(
        folder,
        robot(
            link("rail", [([0, 0, -0.05], [1.0, 0.2, 0.02]), ([0.1 + wall, 0, 0.1], [0.1, 0.2, 0.27])]),  # noqa: E501
            link("block", [([0, 0, 0.02], [0.1, 0.1, 0.1])]),
            joint("slide", "prismatic", "rail", "block", [0, 0, 0], axis, (0, travel), friction=friction, damping=damping),  # noqa: E501
        ),
    )  # fmt: skip


def door_mesh(
    folder: Path,
    *,
    flipped: bool = False,
    hole: bool = False,
    nan: bool = False,
    absent: bool = False,
) -> str:
    """The door as a mesh file; what a URDF says to show it."""
    (center, size) = DOOR[0]
    mesh = trimesh.creation.box(size, trimesh.transformations.translation_matrix(center))
    faces = mesh.faces[:, ::-1] if flipped else mesh.faces[:-1] if hole else mesh.faces
    lines = [f"v {text(v)}" for v in mesh.vertices] + [f"f {text(f + 1)}" for f in faces]
    if nan:
        lines[0] = "v nan 0 0"
    folder.mkdir(parents=True, exist_ok=True)
    if not absent:
        (folder / "door.obj").write_text("\n".join(lines) + "\n")
    return '<visual><geometry><mesh filename="door.obj"/></geometry></visual>'


STOVE = """<mujoco model="stove">
  <compiler angle="radian"/>
  <worldbody>
    <body name="top">
      <geom type="box" size=".3 .3 .02" mass="5"/>
      <body name="burner" pos="0 0 .03">
        <joint name="burner_slide" type="slide" axis="0 0 -1" range="-.009 0" limited="true"/>
        <geom type="cylinder" size=".1 .008" mass=".3"/>
      </body>
      <body name="dial" pos="-.33 0 0">
        <joint name="dial_joint" axis="1 0 0" range="-1.566 0" limited="true" damping=".02"/>
        <geom type="box" size=".02 .03 .01" mass=".05"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="dial_joint" joint2="burner_slide" polycoef="0 174 0 0 0"/></equality>
</mujoco>
"""
MJCF = """<mujoco model="planted">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.6"/>
    <body name="frame">
      <geom type="box" size=".3 .4 .02" pos="0 0 -.3" mass="5"/>
      <geom type="box" size=".3 .02 .3" pos="0 .38 0" mass="5"/>
      <geom type="box" size=".02 .4 .3" pos=".28 0 0" mass="5"/>
      <body name="flap" pos="-.305 .36 0">
        <joint name="flap_hinge" axis="0 0 {sign}" range="0 {upper}" limited="true" frictionloss=".05"/>
        <geom type="box" size=".015 .32 .2" pos="-.02 -.33 0" mass="1"/>
        <geom type="sphere" size=".03" pos="-.08 -.6 0" mass=".1" name="knob"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="flap_hinge" kp="1000"/></actuator>
</mujoco>
"""  # noqa: E501
