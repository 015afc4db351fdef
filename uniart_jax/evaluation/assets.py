"""Real assets through the voxels and back, without any network: what the representation can hold of
them, by category and resolution."""

from __future__ import annotations

import collections
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax.data.card import error_kinds
from uniart_jax.data.folder import Settings
from uniart_jax.data.sources import Entry, find_entries, load_entry
from uniart_jax.evaluation.reconstruction import reconstruct, score_reconstruction
from uniart_jax.evaluation.runner import run_or_reason, write_metrics
from uniart_jax.evaluation.summary import mean_known
from uniart_jax.evaluation.table import markdown
from uniart_jax.runtime.progress import messages

COLUMNS = {
    "chamfer": "Chamfer",
    "chamfer_open": "Chamfer open",
    "part_iou": "part IoU",
    "count": "count",
    "tree": "tree",
    "recall": "moving found",
    "parts_right": "parts right",
    "axis_median": "axis (deg)",
    "opens_wrong_way": "wrong way",
    "pivot_median": "pivot",
    "range_iou": "range IoU",
}
MAX_PARTS = 255
console = messages()
Scores = dict[int, dict[str, float]]


def evaluate_assets(
    root: Path,
    out: Path,
    *,
    resolutions: Sequence[int] = (32, 64),
    subdivisions: int = 4,
    allow_outside: bool = False,
    count: int | None = None,
    processes: int = 1,
) -> dict[str, Any]:
    """Round trip of every asset below ``root``. Writes ``metrics.json`` (every object) and
    ``table.md`` (every category).

    Raises:
      FileNotFoundError: no assets. ValueError: none of them came through.
    """
    settings = Settings(
        "urdf", root=str(root), allow_outside=allow_outside, subdivisions=subdivisions
    )
    entries = find_entries(root, "urdf")[:count]
    trip = functools.partial(_round_trip, settings, tuple(resolutions))
    results = list(run_or_reason(trip, entries, "assets", processes=processes))
    good = [(e, r) for e, r in zip(entries, results, strict=True) if not isinstance(r, str)]
    bad = {e.key: r for e, r in zip(entries, results, strict=True) if isinstance(r, str)}
    if not good:
        raise ValueError(
            f"'{root}': no asset came through, the first because: {next(iter(bad.values()))}"
        )
    groups: dict[str, list[Scores]] = collections.defaultdict(list)
    for entry, scores in good:
        groups[entry.category or "-"].append(scores)
    groups["all"] = [scores for _, scores in good]
    rows = {
        f"{category}, {resolution}": {
            "objects": len(scores),
            **{name: mean_known([s[resolution][name] for s in scores]) for name in COLUMNS},
        }
        for category, scores in groups.items()
        for resolution in resolutions
    }
    results_by_object = {e.key: {str(r): s for r, s in scores.items()} for e, scores in good}
    content = {"rows": rows, "objects": results_by_object, "errors": bad}
    write_metrics(out, content, table(rows))
    print(table(rows))
    if bad:
        kinds = "; ".join(
            f"{n} {kind}" for kind, n in error_kinds([{"error": e} for e in bad.values()])
        )
        console.print(f"{len(bad)} of {len(entries)} assets did not come through: {kinds}")
    return content


def table(rows: dict[str, dict[str, float]]) -> str:
    """Markdown: a line a category and resolution; "-" where nothing is measured (no joint of the
    kind)."""
    lines = []
    for name, row in rows.items():
        cells = ["-" if np.isnan(row[key]) else f"{row[key]:.3f}" for key in COLUMNS]
        lines.append([name, f"{row['objects']:.0f}", *cells])
    return markdown(["category, R", "objects", *COLUMNS.values()], lines)


def _round_trip(settings: Settings, resolutions: Sequence[int], entry: Entry) -> Scores:
    """The figures at each resolution."""
    obj = load_entry(entry, settings).normalized()
    if len(obj.parts) > MAX_PARTS:
        raise ValueError(f"{len(obj.parts)} parts, more than {MAX_PARTS}")
    return {
        r: score_reconstruction(obj, reconstruct(obj, r, settings.subdivisions))
        for r in resolutions
    }
