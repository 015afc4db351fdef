"""MJCF texts by the body, for the tests of reading."""

from __future__ import annotations

BOX = '<geom type="box" size=".1 .2 .3"/>'
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt .9 0\nvt .9 .6\nvt 0 1\n"
TETRAHEDRON = QUAD + "f 1/1 3/3 2/2\nf 1/1 4/4 3/3\nf 1/1 2/2 4/4\nf 2/2 3/3 4/4\n"


def body(name: str, inner: str = BOX, place: str = "") -> str:
    return f'<body name="{name}" {place}>{inner}</body>'


def mjcf(world: str, above: str = "", model: str = "thing") -> str:
    return (
        f'<mujoco model="{model}"><compiler '
        f'angle="radian"/>{above}<worldbody>{world}</worldbody></mujoco>'
    )


def door(joint: str, inner: str = "") -> str:
    """A body in the world and one that moves on it."""
    return mjcf(body("base", BOX + body("door", BOX + joint + inner, 'pos=".5 0 0"')))
