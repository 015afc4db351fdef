"""Statistics of real articulated objects beside the procedural generators', family by family: what
the real ones have that ours lack.

    python tools/compare_worlds.py REAL_ROOT [--count 300] [--out table.md]

REAL_ROOT holds assets in any format that is read, the category of each from its meta.json or its
folder (PartNet-Mobility's names). Only numbers come out: no shape, texture or picture. Seconds to
minutes: every asset is read once.

Every object becomes numbers at its rest state, normalised (longest side 1, z up, front at -x): some
of the object, some of each moving part, by what the part is for (``role``). ``compare`` puts the
quantiles of both worlds into rows and says which share of the real values lies inside what is
generated; ``nearest`` asks how well the best of the generated objects fits each real one.
"""

from __future__ import annotations

import argparse
import collections
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uniart_jax import procedural
from uniart_jax.data.folder import Settings
from uniart_jax.data.layouts import part_colors
from uniart_jax.data.sources import find_entries, load_entry
from uniart_jax.evaluation.parts import match_parts
from uniart_jax.objects.appearance import linear_to_srgb
from uniart_jax.objects.object import ArticulatedObject, Part
from uniart_jax.objects.thresholds import RIGHT_BOX

FAMILIES = {
    "StorageFurniture": "storage_furniture",
    "Table": "table",
    "Refrigerator": "refrigerator",
    "Dishwasher": "dishwasher",
    "Oven": "oven",
    "WashingMachine": "washer",
    "Microwave": "microwave",
}
ROLES = ("door", "flap", "lid", "drawer", "button", "knob", "plate", "slider", "fixed")
QUANTILES = (0.05, 0.5, 0.95)
INSIDE = (0.01, 0.99)  # quantiles of the generated values between which a real one lies inside
SLACK = 0.005  # and by how much it may miss them: of object units, shares, degrees
COVERED = 0.6  # share of a part's front behind other parts from which it is hidden
FEW = 3  # real values below which a row says nothing

Values = dict[str, list[float]]  # "role: statistic" -> one value an object or a part


def role(part: Part) -> str:
    """What a moving part is for, by its joint: see ``ROLES``."""
    joint, size = part.joint, part.box[3:]
    axis = int(np.abs(joint.direction).argmax())
    if joint.type == "fixed":
        return "fixed"
    if joint.type == "prismatic":
        if axis == 0 and size[1:].max() > 0.1:
            return "drawer"
        return "button" if size.max() < 0.1 else "slider"
    if joint.type == "continuous" or axis == 0:
        return "knob" if axis == 0 or size.max() < 0.1 else "plate"
    if axis == 2:
        return "door"
    return "flap" if size[2] > size[0] else "lid"


def object_values(obj: ArticulatedObject) -> Values:
    """The statistics of one object, any scale and shown state."""
    obj = obj.shown_at(obj.rest()).normalized()
    found: Values = collections.defaultdict(list)
    lo, hi = obj.bounds
    size, colors = hi - lo, linear_to_srgb(np.clip(part_colors(obj), 0, 1))
    moving = [k for k, part in enumerate(obj.parts) if part.joint.type != "fixed"]
    found["object: moving parts"].append(len(moving))
    found["object: fixed parts"].append(len(obj.parts) - 1 - len(moving))
    found["object: width / height"].append(size[1] / size[2])
    found["object: depth / height"].append(size[0] / size[2])
    found["object: depth / width"].append(size[0] / size[1])
    found["object: luminance"].append(float(colors[0] @ [0.2126, 0.7152, 0.0722]))
    found["object: saturation"].append(float(np.ptp(colors[0]) / max(colors[0].max(), 1e-6)))
    front = [k for k in moving if role(obj.parts[k]) in ("door", "flap", "drawer")]
    share = sum(float(np.prod(obj.parts[k].box[4:6])) for k in front)
    found["object: front that opens"].append(share / float(size[1] * size[2]))
    counts = collections.Counter(role(part) for part in obj.parts[1:])
    for name in ROLES:
        found[f"{name}: an object"].append(counts[name])
    for k, part in enumerate(obj.parts[1:], 1):
        name = role(part)
        for statistic, value in part_values(obj, k, (lo, hi)).items():
            found[f"{name}: {statistic}"].append(value)
        contrast = np.abs(colors[k] - colors[part.parent]).max()
        found[f"{name}: colour contrast"].append(float(contrast))
    return found


def part_values(obj: ArticulatedObject, k: int, bounds) -> dict[str, float]:
    """The statistics of part ``k`` of a normalised object at rest; ``bounds``: the object's
    corners."""
    part, (lo, hi) = obj.parts[k], bounds
    joint, size = part.joint, part.box[3:]
    a, b = part.mesh.bounds
    whole = hi - lo
    found = {
        "depth (x)": size[0],
        "width (y)": size[1],
        "height (z)": size[2],
        "width of object's": size[1] / whole[1],
        "height of object's": size[2] / whole[2],
        "depth of object's": size[0] / whole[0],
        "bottom above floor": (a[2] - lo[2]) / whole[2],
        "off centre": abs((a[1] + b[1]) / 2 - (lo[1] + hi[1]) / 2) / whole[1],
        "behind object's front": (a[0] - lo[0]) / whole[0],
        "child of the root": float(part.parent == 0),
        "hidden": float(_hidden(obj, k)),
    }
    if joint.type == "fixed":
        return found
    axis = int(np.abs(joint.direction).argmax())
    found["axis off square (deg)"] = float(
        np.rad2deg(np.arccos(min(np.abs(joint.direction).max(), 1)))
    )
    if joint.type == "prismatic":
        found["travel of depth"] = (joint.travel[1] - joint.travel[0]) / max(size[axis], 1e-6)
        return found
    found["opens (deg)"] = float(np.rad2deg(joint.angle[1] - joint.angle[0]))
    if (kind := role(part)) in ("door", "flap"):
        across, side = (1, "on the left") if kind == "door" else (2, "at the top")
        from_ends = joint.origin[across] - a[across], b[across] - joint.origin[across]
        near_end = abs(from_ends[1]) <= abs(from_ends[0])
        found[f"hinge {side}"] = float(near_end)
        found["axis inside its edge"] = from_ends[int(near_end)]
        found["axis behind its front"] = joint.origin[0] - a[0]
    elif axis == 0:
        found["axis off its centre"] = float(np.abs(joint.origin[1:] - part.box[1:3]).max())
        sides = max(size[1:].max(), 1e-6)
        found["height of its width"] = size[2] / max(size[1], 1e-6)
        found["reach of its width"] = size[0] / sides
    return found


def _hidden(obj: ArticulatedObject, k: int, grid: int = 8) -> bool:
    """Whether other moving parts' boxes lie before most of a part's front."""
    a, b = obj.parts[k].mesh.bounds
    y, z = (a[i] + (np.arange(grid) + 0.5) / grid * (b[i] - a[i]) for i in (1, 2))
    covered = np.zeros((grid, grid), bool)
    for j, other in enumerate(obj.parts):
        lo, hi = other.mesh.bounds
        if j in (0, k) or lo[0] > a[0] - 1e-3:
            continue
        covered |= ((y > lo[1]) & (y < hi[1]))[:, None] & ((z > lo[2]) & (z < hi[2]))[None]
    return bool(covered.mean() > COVERED)


def gather(values: Sequence[Values]) -> dict[str, np.ndarray]:
    """The values of many objects, joined."""
    joined: Values = collections.defaultdict(list)
    for one in values:
        for name, numbers in one.items():
            joined[name] += numbers
    return {name: np.array(numbers, np.float64) for name, numbers in joined.items()}


def compare(real: Sequence[Values], made: Sequence[Values]) -> list[dict[str, object]]:
    """A row a statistic: {"statistic", "values", "real" quantiles, "made" quantiles or None,
    "inside" share}."""
    ours, rows = gather(made), []
    for name, numbers in sorted(gather(real).items(), key=lambda item: _order(item[0])):
        if len(numbers) < FEW or (name.endswith(": an object") and not numbers.any()):
            continue
        row = {"statistic": name, "values": len(numbers), "real": np.quantile(numbers, QUANTILES)}
        row |= {"mean": float(numbers.mean()), "made": None, "made_mean": 0.0, "inside": 0.0}
        if len(ours.get(name, ())) >= FEW:
            low, high = np.quantile(ours[name], INSIDE)
            row["made"] = np.quantile(ours[name], QUANTILES)
            row["made_mean"] = float(ours[name].mean())
            row["inside"] = float(((numbers >= low - SLACK) & (numbers <= high + SLACK)).mean())
        rows.append(row)
    return rows


def _order(name: str) -> tuple[int, str]:
    first = name.split(":")[0]
    return (0 if first == "object" else 1 + ROLES.index(first), "" if "an object" in name else name)


def table(rows: Sequence[dict[str, object]]) -> str:
    """Markdown; quantiles .05, .5, .95 (mean)."""
    lines = ["| statistic | values | real | generated | inside |", "|---|---|---|---|---|"]
    for row in rows:
        spans = [_span(row["real"], row["mean"]), _span(row["made"], row["made_mean"])]
        cells = [row["statistic"], row["values"], *spans, f"{row['inside']:.2f}"]
        lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    return "\n".join(lines)


def _span(quantiles, mean) -> str:
    if quantiles is None:
        return "none"
    return " · ".join(f"{q:.2f}" for q in quantiles) + f" ({mean:.2f})"


def at_rest(obj: ArticulatedObject) -> tuple[np.ndarray, list[str], np.ndarray]:
    """Boxes [K, 6] at rest, normalised; roles of the K parts, the root's "root"; boxes are all that
    ``nearest`` reads."""
    obj = obj.shown_at(obj.rest()).normalized()
    names = ["root"] + [role(part) for part in obj.parts[1:]]
    return obj.boxes, names, np.array([n not in ("root", "fixed") for n in names])


def nearest(real, made) -> tuple[int, int, int]:
    """How well the best of ``made`` fits ``real`` (``at_rest`` of each).

    Returns:
      (moving parts of the real object within ``RIGHT_BOX`` of one of the same role, moving parts,
      index of the best).
    """
    boxes, names, moving = real
    best, index = -1, -1
    for i, (other, others, _) in enumerate(made):
        match, distance = match_parts(other, boxes)
        good = sum(
            bool(moving[k] and distance[k] < RIGHT_BOX and others[match[k]] == names[k])
            for k in range(len(boxes))
        )
        if good > best:
            best, index = good, i
    return max(best, 0), int(moving.sum()), index


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--count", type=int, default=300, help="procedural objects a family")
    parser.add_argument("--start", type=int, default=0, help="their first seed")
    parser.add_argument("--out", type=Path, help="write the table here too")
    given = parser.parse_args()
    settings, text = Settings("urdf", root=str(given.root)), []
    groups: dict[str, list] = {}
    for entry in find_entries(given.root, "urdf"):
        if entry.category not in FAMILIES:
            continue
        try:
            groups.setdefault(entry.category, []).append(load_entry(entry, settings))
        except (ValueError, FileNotFoundError) as error:
            print(f"left out {entry.key}: {error}")
    for category, objects in groups.items():
        seeds = range(given.start, given.start + given.count)
        made = [procedural.generate(FAMILIES[category], seed) for seed in seeds]
        rows = compare([object_values(o) for o in objects], [object_values(o) for o in made])
        ours = [at_rest(o) for o in made]
        fits = [nearest(at_rest(o), ours)[:2] for o in objects]
        share = sum(f[0] for f in fits) / max(sum(f[1] for f in fits), 1)
        text += [
            f"### {category}: {len(objects)} real objects, {len(made)} generated",
            "",
            table(rows),
            "",
            f"Of the real moving parts, {share:.2f} lie within .1 of one of the same kind in the "
            "generated object that fits best.",
            "",
        ]
        print("\n".join(text[-6:]), flush=True)
    if given.out:
        given.out.write_text("\n".join(text))


if __name__ == "__main__":
    main()
