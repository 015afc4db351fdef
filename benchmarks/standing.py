"""How assets stand on their own: dropped free onto a plane in MuJoCo.

    python benchmarks/standing.py FOLDER [FOLDER ...]     FOLDER: of an asset, or of several

For each asset with an `object.xml`: how far the lowest point that is seen has sunk into the plane
(share of the longest side; below 0: it hovers), by how much the base leans, and which bodies touch
the plane. Collision shapes that miss a leg let an object sink, lean or stand on a door.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import mujoco
import numpy as np

SECONDS = 3.0
DROP = 0.002  # metres above the plane
PLANE = "plane that assets are dropped on"
VISUAL = 2  # geom group of what is seen (export/mjcf.py)


def dropped(path: Path) -> tuple[float, float, set[str]]:
    """Sunk (share of the longest side), leaning (degrees), bodies on the plane."""
    spec = mujoco.MjSpec.from_file(str(path))
    for key in list(spec.keys):
        spec.delete(key)
    spec.worldbody.first_body().add_freejoint()
    spec.worldbody.add_geom(name=PLANE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    size = float(np.ptp(_seen(model, data), axis=0).max())
    data.qpos[2] += DROP
    while data.time < SECONDS:
        mujoco.mj_step(model, data)
    upright = float(data.xmat[1].reshape(3, 3)[2, 2])
    plane = model.geom(PLANE).id
    pairs = [{contact.geom1, contact.geom2} for contact in data.contact]
    touching = {geom for pair in pairs if plane in pair for geom in pair - {plane}}
    names = {model.body(model.geom_bodyid[geom]).name for geom in touching}
    leaning = float(np.degrees(np.arccos(np.clip(upright, -1, 1))))
    return -float(_seen(model, data)[:, 2].min()) / size, leaning, names


def _seen(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """[n, 3] vertices of all that is seen, metres."""
    found = []
    for geom in np.flatnonzero(model.geom_group == VISUAL):
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        found.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(found)


def assets(folder: Path) -> list[Path]:
    """The description in a folder, or those in the folders in it."""
    own = folder / "object.xml"
    return [own] if own.is_file() else sorted(folder.glob("*/object.xml"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    folders = parser.parse_args().folders
    paths = [path for folder in folders for path in assets(folder)]
    if not paths:
        print("standing: no object.xml in these folders; give asset folders", file=sys.stderr)
        raise SystemExit(2)
    rows = []
    for path in paths:
        sunk, leaning, names = dropped(path)
        rows.append((abs(sunk), leaning))
        where = ", ".join(sorted(names))
        print(f"{path.parent.name}: sinks {sunk:.4f}, leans {leaning:.1f} degrees, on {where}")
    sunk, leaning = np.array(rows).T
    off, tilted = int((sunk >= 0.005).sum()), int((leaning >= 1).sum())
    print(f"of {len(rows)}: sunk or hovering by .005 and more {off} (most {sunk.max():.4f})")
    print(f"leaning by 1 degree and more {tilted} (most {leaning.max():.1f})")


if __name__ == "__main__":
    main()
