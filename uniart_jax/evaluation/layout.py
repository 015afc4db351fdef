"""Layouts of held-out procedural or of real objects, from one picture each, against the truth:
``uniart evaluate layout``.

Figures are over moving parts (``evaluation.parts``: found, right) or over objects (count, tree),
for all objects, by family and by number of moving parts; intervals resample objects.
``calibration``: expected calibration error of the rows' confidence against whether a row matches a
true part within ``thresholds.FOUND``.

Of procedural objects it is known which parts the picture shows (``SEEN``). No picture says where a
drawer behind a closed door is, or whether there is one: ``sight`` has the figures of moving parts
that are seen and of those that are hidden, and of objects without and with hidden moving parts.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from uniart_jax.data.images import MARGIN, PICTURE_SIDE, crop
from uniart_jax.evaluation.parts import PartScores, compare_parts, match_parts, summarize
from uniart_jax.evaluation.photographed import SIDE, cut_again
from uniart_jax.evaluation.procedural import HeldOut, check_first_seed, held_out
from uniart_jax.evaluation.real import RealObject, real_objects
from uniart_jax.evaluation.runner import run, write_metrics
from uniart_jax.evaluation.summary import LEVEL, RESAMPLES, SEED
from uniart_jax.inference.ask_layout import ask_command, ask_layout
from uniart_jax.inference.layouts import load_layout_predictor
from uniart_jax.inference.masks import load_mask_predictor
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.objects.thresholds import FOUND
from uniart_jax.procedural import HELD_OUT_SEED
from uniart_jax.runtime.progress import messages, track
from uniart_jax.visual.layout_picture import contact_sheet, draw_layout
from uniart_jax.voxels.joint_code import box_corners
from uniart_jax.voxels.layout import Layout
from uniart_jax.voxels.read_layout import read_layout

BINS = 10
COUNT = 128  # held-out objects
SHOWN = (
    20  # objects on the contact sheet: the first ones, of real ones evenly spread over the folder
)
SEEN = 13 / 256**2  # share of the picture from which a part counts as seen
SIZES = ((1, 1), (2, 3), (4, 7), (8, 99))  # moving parts, from and to
INTERVALS = ("parts_right", "recall", "count")
console = messages()


def score_layout(
    layout: Layout, test: HeldOut | RealObject
) -> tuple[PartScores, np.ndarray, np.ndarray]:
    """Part scores of a layout as an object of boxes, its rows' confidence [K] and whether each
    matches a true part [K]."""
    _, distance = match_parts(test.obj.boxes, layout.boxes)  # for each row of the layout
    return compare_parts(layout.to_object(), test.obj), layout.confidence, distance < FOUND


def figures(scored: Sequence[tuple[PartScores, np.ndarray, np.ndarray]]) -> dict[str, float]:
    """The figures of some objects."""
    scores = [s for s, _, _ in scored]
    rows = summarize(scores)
    error = np.concatenate([s.box_error[s.moving] for s in scores])
    matched = error[error < FOUND]
    rows["box_median"] = float(np.median(matched)) if len(matched) else float("nan")
    sure = np.concatenate([confidence for _, confidence, _ in scored])
    hits = np.concatenate([hit for _, _, hit in scored])
    rows["calibration"] = calibration_error(sure, hits)
    return rows


def calibration_error(confidence: np.ndarray, hits: np.ndarray) -> float:
    """Mean gap between confidence [n] and the share of hits [n], over ``BINS`` bins of confidence,
    weighted by their rows."""
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gaps = [abs((confidence - hits)[bins == b].sum()) for b in range(BINS)]
    return float(sum(gaps) / max(len(confidence), 1))


def with_intervals(scored: Sequence[Any]) -> dict[str, Any]:
    """``figures`` and, of ``INTERVALS``, the bootstrap interval over objects as
    "<name>_interval"."""
    found: dict[str, Any] = figures(scored)
    rng = np.random.default_rng(SEED)
    draws = [
        summarize([scored[i][0] for i in rng.integers(len(scored), size=len(scored))])
        for _ in range(min(RESAMPLES, 500))
    ]
    tail = 100 * (1 - LEVEL) / 2
    for name in INTERVALS:
        values = np.percentile([draw[name] for draw in draws], (tail, 100 - tail))
        found[f"{name}_interval"] = [float(v) for v in values]
    return found


def by_sight(scores: Sequence[PartScores], sights: Sequence[np.ndarray]) -> dict[str, Any]:
    """{"parts": {"seen", "hidden"}, "objects": {…}}: moving parts by whether the picture shows them
    (``sights``: [K] shares of it), objects by whether it shows all of theirs."""
    join = lambda name: np.concatenate([getattr(s, name) for s in scores])  # noqa: E731
    seen = [np.asarray(sight) >= SEEN for sight in sights]
    of_part, moving = np.concatenate(seen), join("moving")
    of_object = np.array([bool(row[s.moving].all()) for row, s in zip(seen, scores, strict=True)])
    found: dict[str, Any] = {"parts": {}, "objects": {}}
    for name, parts, objects in (("seen", of_part, of_object), ("hidden", ~of_part, ~of_object)):
        rows = moving & parts
        found["parts"][name] = {
            "recall": float(join("found")[rows].mean()) if rows.any() else float("nan"),
            "parts_right": float(join("right")[rows].mean()) if rows.any() else float("nan"),
            "moving_parts": int(rows.sum()),
        }
        some = [s for s, yes in zip(scores, objects, strict=True) if yes]
        found["objects"][name] = {
            "count": float(np.mean([s.count_right for s in some])) if some else float("nan"),
            "tree": float(np.mean([s.tree_right for s in some])) if some else float("nan"),
            "objects": len(some),
        }
    return found


def judge(layouts: Sequence[Layout], tests: Sequence[HeldOut | RealObject]) -> dict[str, Any]:
    """All figures: {"all", "families": {name: …}, "moving_parts": {"2-3": …}}, and "sight"
    (``by_sight``) where it is known."""
    scored = [score_layout(layout, test) for layout, test in zip(layouts, tests, strict=True)]
    families = {
        family: figures([s for s, t in zip(scored, tests, strict=True) if t.family == family])
        for family in dict.fromkeys(t.family for t in tests)
    }
    sizes = {}
    for low, high in SIZES:
        some = [s for s in scored if low <= s[0].moving.sum() <= high]
        if some:
            sizes[f"{low}-{high}" if high < 99 else f"{low}+"] = figures(some)
    found = {"all": with_intervals(scored), "families": families, "moving_parts": sizes}
    sights = [getattr(test, "sight", None) for test in tests]
    known = [sight for sight in sights if sight is not None]
    if len(known) == len(sights):
        found["sight"] = by_sight([s for s, _, _ in scored], known)
    return found


def evaluate_layout(
    checkpoint: str,
    out: Path,
    *,
    root: Path | None = None,
    count: int | None = None,
    unseen: bool = False,
    families: tuple[str, ...] = (),
    first_seed: int | None = None,
    pred: Path | None = None,
    ask: str | None = None,
    cache: Path | None = None,
    allow_outside: bool = False,
    processes: int = 1,
    backgrounds: bool = False,
    predictor: Callable[[Sequence[np.ndarray]], list[dict[str, np.ndarray]]] | None = None,
) -> dict[str, Any]:
    """Judge a checkpoint's layouts, or those of files PRED/<index>.json, of held-out objects or of
    the assets below ``root``.

    Args:
      out: gets metrics.json and layouts.png. count: objects (default ``COUNT`` held-out ones, or
        all assets). families: of the held-out ones, in turn, in place of a split's.
      first_seed: of the first of them (default ``HELD_OUT_SEED``). ask: a command that asks a
        vision-language model (``inference.ask_layout``), shown <index>.png.
      cache: keeps the assets' pictures (default OUT/objects).
      backgrounds: each object stands in front of a random background, and is cut out of it as a
        photograph is (``evaluation.photographed``). predictor: in place of the
        checkpoint's
        (``inference.layouts.LayoutPredictor``).
    """
    if pred is not None and ask is not None:
        raise ValueError("evaluate layout: give --pred or --ask, not both")
    if pred is not None and backgrounds:
        raise ValueError(
            "evaluate layout: it takes no --backgrounds with --pred, which looks at none"
        )
    number = COUNT if count is None else count
    first = HELD_OUT_SEED if first_seed is None else first_seed
    if root is None:
        check_first_seed(first, number)
    if pred is None and predictor is None:
        predictor = load_layout_predictor(checkpoint)
    size = getattr(predictor, "image_size", PICTURE_SIDE)
    side = max(PICTURE_SIDE, size, 2 * SIDE if backgrounds else 0)
    margin = getattr(predictor, "crop_margin", MARGIN)
    out.mkdir(parents=True, exist_ok=True)
    settings: dict[str, Any] = {"unseen": unseen, "checkpoint": str(pred or checkpoint)}
    tests: list[HeldOut] | list[RealObject]
    if root is None:
        make = functools.partial(
            held_out, unseen=unseen, families=families, first_seed=first, image_size=side
        )
        settings |= {"families": families, "first_seed": first}
        tests = list(run(make, range(number), "held-out objects", processes=processes))
        shown = list(range(min(SHOWN, number)))
    else:
        tests, refused = real_objects(
            root, cache or out / "objects", image_size=side, count=count,
            allow_outside=allow_outside, processes=processes,
        )  # fmt: skip
        settings |= {"root": Path(root).name, "refused": refused}
        for name, why in refused.items():
            console.print(f"left out {name}: {why}", markup=False)
        shown = np.linspace(0, len(tests) - 1, min(SHOWN, len(tests))).round().astype(int).tolist()
    settings["count"] = len(tests)
    seen = [test.image for test in tests]
    if backgrounds:
        network = load_mask_predictor(Checkpoint.find(checkpoint))
        cut = [
            cut_again(tests, i, network)
            for i in track(range(len(tests)), "photographs", len(tests))
        ]
        seen = [picture for picture, _, _ in cut]
        ways = [way for _, _, way in cut]
        settings |= {
            "backgrounds": {way: ways.count(way) for way in sorted(set(ways))},
            "mask_overlap": float(np.mean([score for _, score, _ in cut])),
        }
    crops = [crop(picture, size, margin) for picture in seen]
    if pred is not None:
        layouts = [_read(Path(pred) / f"{i}.json") for i in range(len(tests))]
    else:
        assert predictor is not None  # given, or the checkpoint's
        layouts = [read_layout(found) for found in predictor(crops)]
    if ask is not None:
        layouts, unanswered = _asked(ask, seen, layouts, margin)
        settings |= {"ask": ask, "unanswered": unanswered}
    found = judge(layouts, tests)
    if root is not None:
        found["objects"] = [t.name for t in tests]
    write_metrics(out, {"settings": settings, **found})
    drawn = [draw_layout(crops[i], layouts[i]) for i in shown]
    contact_sheet(drawn).save(out / "layouts.png")
    console.print(table(found))
    if "sight" in found:
        console.print(sight_line(found["sight"]), highlight=False)
    return found


def _read(path: Path) -> Layout:
    if not path.is_file():
        raise FileNotFoundError(
            f"evaluate layout: no '{path}'; give one <index>.json for each object"
        )
    layout = Layout.from_json(path.read_text())
    return without_fixed(layout.normalized()[0] if layout.metres else layout)


def without_fixed(layout: Layout) -> Layout:
    """A layout in which rows that are fixed to others are one with them, as true objects have it: a
    box around both. Of layouts that are told; those of networks are judged as they are."""
    corners, parents = box_corners(layout.boxes), list(layout.parents)
    fixed = {
        k for k, joint in enumerate(layout.joints) if parents[k] >= 0 and joint.type == "fixed"
    }

    def carrier(k: int) -> int:
        return carrier(parents[k]) if k in fixed else k

    for k in fixed:
        up = carrier(k)
        corners[up, :3] = np.minimum(corners[up, :3], corners[k, :3])
        corners[up, 3:] = np.maximum(corners[up, 3:], corners[k, 3:])
    boxes = np.concatenate(
        [(corners[:, :3] + corners[:, 3:]) / 2, corners[:, 3:] - corners[:, :3]], 1
    )
    parents = [parent if parent < 0 else carrier(parent) for parent in parents]
    merged = dataclasses.replace(layout, boxes=boxes, parents=tuple(parents))
    return merged.taken([k for k in range(len(layout)) if k not in fixed])


def _asked(
    line: str, pictures: Sequence[np.ndarray], found: Sequence[Layout], margin: float
) -> tuple[list[Layout], list[int]]:
    """What a vision-language model tells of each picture [H, W, 4], and of which no answer is a
    layout; ``found``: the network's, which counts there, and whose cameras are guesses."""
    ask, layouts, unanswered = ask_command(line), [], []
    for i in track(range(len(pictures)), "answers", len(pictures)):
        try:
            told = ask_layout(pictures[i], ask, found[i].camera, margin, name=str(i))
        except ValueError as error:
            console.print(f"object {i}: {error}; the network's layout counts", markup=False)
            unanswered.append(i)
            told = found[i]
        layouts.append(without_fixed(told))
    return layouts, unanswered


def table(found: dict[str, Any]) -> Table:
    """The figures for a terminal."""
    names = {
        "parts_right": "right",
        "recall": "moving found",
        "count": "count",
        "tree": "tree",
        "type_accuracy": "type",
        "opens_wrong_way": "wrong way",
        "pivot_median": "pivot",
        "box_median": "box",
    }
    shown = Table("layouts", *names.values(), "objects")
    groups = {"all": found["all"], **found["families"], **found["moving_parts"]}
    for name, row in groups.items():
        shown.add_row(name, *(f"{row[n]:.3f}" for n in names), f"{row['objects']:.0f}")
    return shown


def sight_line(sight: dict[str, Any]) -> str:
    """``by_sight`` in words; groups of none are left out."""
    parts, objects = sight["parts"], sight["objects"]
    told = [
        f"moving parts {name} in the picture ({parts[name]['moving_parts']}): "
        f"{parts[name]['recall']:.2f} found, {parts[name]['parts_right']:.2f} right"
        for name in ("seen", "hidden")
        if parts[name]["moving_parts"]
    ]
    words = {"seen": "all moving parts are seen", "hidden": "some are hidden"}
    told += [
        f"count {objects[name]['count']:.2f} where {words[name]} ({objects[name]['objects']})"
        for name in ("seen", "hidden")
        if objects[name]["objects"]
    ]
    return "; ".join(told)
