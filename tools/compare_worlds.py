"""Statistics of real articulated objects beside the procedural generators', family by family.

    python tools/compare_worlds.py REAL_ROOT [--count 300] [--out table.md]

REAL_ROOT holds assets in any format that is read, the category of each from its meta.json or its
folder (PartNet-Mobility's names). Only numbers come out: no shape, texture or picture. Seconds to
minutes: every asset is read once.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from uniart_jax import procedural
from uniart_jax.data.folder import Settings
from uniart_jax.data.sources import find_entries, load_entry
from uniart_jax.evaluation.worlds import (
    FAMILIES,
    at_rest,
    compare,
    nearest,
    object_values,
    table,
)


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
