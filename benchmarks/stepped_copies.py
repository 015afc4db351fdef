"""Many copies of an asset in MuJoCo, a ball dropped on each, and how fast they are stepped."""

from __future__ import annotations

import copy
import time
from pathlib import Path

import mujoco
import numpy as np
from lxml import etree

DENSITY = 500.0  # kg / m^3 of the ball
SECONDS, STEPS = 0.7, 200  # of processor time, and steps, that are timed at the most
TOGETHER = 100  # copies a model
SPACING = 3.0  # sizes of the object between copies


def many(asset: Path, copies: int) -> str:
    """An MJCF of many copies of an asset's that stand in a field, a ball dropped on each; without
    what is seen. Meshes are shared.

    MuJoCo's own ``attach`` takes minutes for a thousand.
    """
    one = etree.parse(str(asset / "object.xml")).getroot()
    world = one.find("worldbody")
    for geom in [g for g in world.iter("geom") if g.get("contype") == "0"]:
        geom.getparent().remove(geom)
    used = {geom.get("mesh") for geom in world.iter("geom")}
    for element in list(one.find("asset")):
        if element.tag != "mesh" or element.get("name") not in used:
            one.find("asset").remove(element)
    for tag in ("keyframe", "actuator"):
        for element in one.findall(tag):
            one.remove(element)
    alone = mujoco.MjModel.from_xml_string(etree.tostring(one).decode(), files(asset))
    data = mujoco.MjData(alone)
    mujoco.mj_forward(alone, data)
    reach = alone.geom_rbound[:, None]
    low, high = (data.geom_xpos - reach).min(0), (data.geom_xpos + reach).max(0)
    groups = [one.find(tag) for tag in ("worldbody", "contact", "tendon", "equality")]
    groups = [group for group in groups if group is not None]
    given = [list(group) for group in groups]
    for group in groups:
        group[:] = []
    side = int(np.ceil(copies**0.5))
    step = SPACING * float((high - low).max())
    for i in range(copies):
        at = [step * (i % side), step * (i // side), 0.0]
        for group, elements in zip(groups, given, strict=True):
            for element in elements:
                made = copy.deepcopy(element)
                _renamed(made, f"{i}/")
                if group.tag == "worldbody":
                    own = [float(v) for v in made.get("pos", "0 0 0").split()]
                    made.set("pos", " ".join(str(a + b) for a, b in zip(own, at, strict=True)))
                group.append(made)
        top = " ".join(str(v) for v in (at[0], at[1], float(high[2]) + 0.05))
        ball = etree.SubElement(world, "body", pos=top)
        etree.SubElement(ball, "freejoint")
        etree.SubElement(ball, "geom", type="sphere", size=".03", density=str(DENSITY))
    memory = etree.SubElement(one, "size")
    memory.set("memory", f"{max(64, 4 * copies)}M")
    return etree.tostring(one).decode()


def files(asset: Path) -> dict[str, bytes]:
    """The collision meshes of an asset, by the names that its MJCF has for them."""
    found = (asset / "meshes" / "collision").glob("*.obj")
    return {p.relative_to(asset).as_posix(): p.read_bytes() for p in found}


def _renamed(element: etree._Element, prefix: str) -> None:
    references = ("name", "body1", "body2", "joint", "joint1", "joint2", "tendon1", "tendon2")
    for each in element.iter():
        for key in references:
            if key in each.attrib:
                each.set(key, prefix + each.get(key))


def fields(
    asset: Path, copies: int, together: int = TOGETHER
) -> list[tuple[mujoco.MjModel, mujoco.MjData]]:
    """About ``copies`` of an asset, a ball dropped on each: models of ``together``, and states.

    One model of all takes minutes: MuJoCo's time to compile grows faster than the square of the
    bodies.
    """
    count = max(1, round(copies / together))
    text = many(asset, min(copies, together))
    model = mujoco.MjModel.from_xml_string(text, files(asset))
    models = [model, *(copy.copy(model) for _ in range(count - 1))]
    return [(each, mujoco.MjData(each)) for each in models]


def speed(asset: Path, copies: int, together: int = TOGETHER) -> float:
    """Steps of one object a second of processor time (MuJoCo takes one core), where many stand in
    ``fields`` that are stepped in turn."""
    pairs = fields(asset, copies, together)
    for pair in pairs:
        mujoco.mj_step(*pair)
    start, steps = time.process_time(), 0
    while steps < STEPS and time.process_time() - start < SECONDS:
        for pair in pairs:
            mujoco.mj_step(*pair)
        steps += 1
    stepped = steps * len(pairs) * min(copies, together)
    return stepped / (time.process_time() - start)
