"""Do assets work in a simulator? Objects written as assets, loaded in every engine, their joints
driven; one table.

truth       held-out procedural objects as they were drawn: what export and validation themselves can do
assets      every asset below a folder, read and written anew
sampled     what a checkpoint makes of held-out images
refined     the same objects after ``simulation.refine``
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uniart_jax import procedural
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.data.sources import find_entries
from uniart_jax.evaluation.procedural import held_out_for, opens, split_families
from uniart_jax.evaluation.result_store import ResultStore, check_settings
from uniart_jax.evaluation.runner import DIED, error_line, run, write_metrics
from uniart_jax.evaluation.table import markdown
from uniart_jax.export.asset import save_asset
from uniart_jax.export.frames import joint_name, moves
from uniart_jax.export.naming import named
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import load
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.runtime.progress import messages, track
from uniart_jax.simulation.primitives import REACH
from uniart_jax.simulation.refine import mend
from uniart_jax.simulation.summary import is_plausible, is_sound, stands, verdicts
from uniart_jax.simulation.sweep import DEPTH
from uniart_jax.simulation.validate import validate

FORMATS = ("urdf", "mjcf")
console = messages()


@dataclasses.dataclass(frozen=True)
class AssetCheck:
    """One object to be written as an asset and checked in simulators.

    Attributes:
      row: of the table.
      name: of its folder.
      source: the object, a function that makes it, or why there is none.
    """

    row: str
    name: str
    source: ArticulatedObject | Callable[[], ArticulatedObject] | str

    def make(self) -> ArticulatedObject:
        """The object; raises what its source raises."""
        if isinstance(self.source, str):
            raise ValueError(self.source)
        return self.source if isinstance(self.source, ArticulatedObject) else self.source()


def evaluate_physics(
    out: Path,
    *,
    root: Path | None = None,
    checkpoint: str | None = None,
    count: int | None = None,
    unseen: bool = False,
    engines: Sequence[str] | None = None,
    allow_outside: bool = False,
    processes: int = 1,
) -> dict[str, Any]:
    """Write, load and drive objects. Goes on where it was stopped: results that are there are kept.

    Args:
      out: ``assets/<row>/<name>/`` with ``validation.png``, ``results/<row>/<name>.json``,
        ``metrics.json``, ``table.md``.
      root: a folder of assets. checkpoint: what makes objects of held-out images. Neither: held-out
        objects themselves.
      count: objects; default 200, all assets of a folder, or 64 of a checkpoint.
      engines: default MuJoCo and, where it is installed, PyBullet.

    Raises:
      FileNotFoundError: ``root`` holds no assets. ValueError: both are given, or results of other
        objects lie there.
    """
    if root is not None and checkpoint is not None:
        raise ValueError("evaluate physics: give a folder of assets or --checkpoint, not both")
    settings = {
        "root": str(root or ""),
        "checkpoint": checkpoint or "",
        "unseen": unseen,
        "engines": list(engines or ()),
        "allow_outside": allow_outside,
        "picture": PICTURE_SIDE,
    }
    check_settings(out, settings, "other objects or engines")
    if checkpoint is not None:
        count = count or 64
        sampled = _sampled(checkpoint, count, unseen, out)
        planned = list(track(sampled, "images to objects", 2 * count, unit="assets"))
    else:
        planned = (
            _assets(root, count, allow_outside)
            if root is not None
            else _truth(count or 200, unseen)
        )
    store = ResultStore[AssetCheck](lambda asset: _result_file(out, asset.row, asset.name))
    measure = functools.partial(_check, out / "assets", tuple(engines or ()) or None)
    made = run(
        measure, planned, "assets in simulators", processes=processes, store=store, died=_died
    )
    rows: dict[str, list[dict]] = {}
    for asset, result in zip(planned, made, strict=True):
        rows.setdefault(asset.row, []).append(result)
    table = {row: summarize_checks(results) for row, results in rows.items()}
    content = {**settings, "rows": table, "objects": rows}
    write_metrics(out, content, table_of(table))
    print(table_of(table))
    for row, results in rows.items():
        for result in results:
            if not result["sound"]:
                console.print(f"{row}, {result['name']}: {'; '.join(result['failed']) or 'failed'}")
    return content


def _truth(count: int, unseen: bool) -> list[AssetCheck]:
    families = split_families(unseen)
    drawn = [(families[i % len(families)], procedural.HELD_OUT_SEED + i) for i in range(count)]
    return [
        AssetCheck(
            "truth", f"{family}-{seed}", functools.partial(procedural.generate, family, seed)
        )
        for family, seed in drawn
    ]


def _assets(root: Path, count: int | None, allow_outside: bool) -> list[AssetCheck]:
    entries = find_entries(root, "urdf")[:count]
    # with every joint; ``load_entry`` keeps one a part
    load = functools.partial(load_object, allow_outside=allow_outside)
    return [
        AssetCheck(
            "assets", f"{i:04d}-{Path(e.key).name}", functools.partial(load, Path(root) / e.path)
        )
        for i, e in enumerate(entries)
    ]


def _sampled(checkpoint: str, count: int, unseen: bool, out: Path) -> Iterator[AssetCheck]:
    """Two checks an image, before and after refining; the networks run in this process, only where
    a result is missing."""
    pipeline = None
    for index in range(count):
        name = f"{index:04d}"
        files = [_result_file(out, row, name) for row in ("sampled", "refined")]
        if all(f.is_file() for f in files):
            yield from (AssetCheck(row, name, "done before") for row in ("sampled", "refined"))
            continue
        if pipeline is None:
            enable_compilation_cache()
            pipeline = load(checkpoint)
        model = pipeline.config.model
        test = held_out_for(model, index, unseen)
        try:
            source: ArticulatedObject | str = pipeline(test.image, seed=index)
        except ValueError as error:  # no object in the image: a failure that counts
            source = str(error)
        yield from (AssetCheck(row, name, source) for row in ("sampled", "refined"))


def _result_file(out: Path, row: str, name: str) -> Path:
    return out / "results" / row / f"{name}.json"


def _died(asset: AssetCheck) -> dict:
    return _failure(asset.name, DIED)


def _failure(name: str, why: str, moving: Sequence[str] = ()) -> dict:
    """What an object counts as that could not even be tried; ``moving``: its joints, as far as they
    are known."""
    no = ("sound", "stands", "plausible", "yourdfpy", "watertight")
    nothing = {key: {} for key in ("engines", "joints", "seconds")}
    told = {"name": name, "moving": list(moving), "failed": [why]}
    return told | dict.fromkeys(no, False) | nothing


def _check(assets: Path, engines: Sequence[str] | None, asset: AssetCheck) -> dict:
    """One object's figures; it lies in ``assets/<row>/<name>``."""
    folder, moving = assets / asset.row / asset.name, []
    try:
        obj = named(asset.make())
        moving = [joint_name(part) for part in obj.parts if moves(part)]
        start = time.perf_counter()
        save_asset(
            obj,
            folder,
            formats=FORMATS,
            motion=False,
            overwrite=True,
            mend=mend if asset.row == "refined" else None,
        )
        written = time.perf_counter()
        found = validate(folder, out=folder, engines=engines)
        done = time.perf_counter()
    except Exception as error:  # one object must not cost the figures of all others
        return _failure(asset.name, error_line(error), moving)
    ran = found["engines"]
    failed = [
        f"{where} {name} ({check.get('reason', check['value'])})"
        for where, checks in verdicts(found).items()
        for name, check in checks.items()
        if not check["passed"]
    ]
    return {
        "name": asset.name,
        "moving": moving,
        "sound": is_sound(found),
        "stands": stands(verdicts(found)),
        "plausible": is_plausible(verdicts(found)),
        "failed": failed,
        "engines": {e: {name: c["passed"] for name, c in checks.items()} for e, checks in ran.items()},  # noqa: E501
        "yourdfpy": opens("yourdfpy", folder / "object.urdf"),
        "watertight": bool(found["geometry"]["watertight"]["passed"]),
        "joints": {
            e: {name: _works(joint) for name, joint in found["joints"][e].items()} for e in ran
        },
        "seconds": {"export": written - start, "validate": done - written},
    }  # fmt: skip


def _works(joint: dict) -> bool:
    """The paper's rule: the driven joint comes to 70 % of its range and nothing runs into
    anything."""
    return joint["reached"] >= REACH and joint["collision"] <= DEPTH


def summarize_checks(results: Sequence[dict]) -> dict[str, float]:
    """Shares of objects and of joints, and median seconds. An object that could not be tried fails
    everything, its moving joints too."""
    engines = sorted({engine for r in results for engine in r["engines"]})
    row: dict[str, float] = {"objects": len(results)}
    for engine in engines:
        loaded = [r["engines"].get(engine, {}).get("loads", False) for r in results]
        row[f"loads {engine}"] = float(np.mean(loaded))
    row["loads yourdfpy"] = float(np.mean([r["yourdfpy"] for r in results]))
    row["watertight"] = float(np.mean([r["watertight"] for r in results]))
    for engine in engines:
        row[f"stands {engine}"] = float(
            np.mean([r["engines"].get(engine, {}).get("stands", False) for r in results])
        )
    for engine in engines:
        works = [
            r["joints"].get(engine, {}).get(name, False)
            for r in results
            for name in {*r["moving"], *r["joints"].get(engine, {})}
        ]
        row[f"joints {engine}"] = len(works)
        row[f"70 % {engine}"] = float(np.mean(works)) if works else 0.0
    for title, what in {"loads and stands": "stands", "plausible": "plausible"}.items():
        if all(what in r for r in results):  # kept figures may be older
            row[title] = float(np.mean([r[what] for r in results]))
    row["sound"] = float(np.mean([r["sound"] for r in results]))
    for step in ("export", "validate"):
        taken = [r["seconds"][step] for r in results if r["seconds"]]
        row[f"{step} s"] = float(np.median(taken)) if taken else 0.0
    return row


def table_of(rows: dict[str, dict[str, float]]) -> str:
    """Markdown: a line a row."""
    columns = list(dict.fromkeys(key for row in rows.values() for key in row))
    lines = [
        [name, *(_cell(key, row[key]) if key in row else "-" for key in columns)]
        for name, row in rows.items()
    ]
    return markdown(["", *columns], lines)


def _cell(key: str, value: float) -> str:
    return f"{value:.0f}" if key == "objects" or key.startswith("joints") else f"{value:.3g}"
