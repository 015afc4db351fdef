"""``uniart prepare | features | inspect | stats``: training records."""

from __future__ import annotations

import dataclasses
import functools
import os
import shlex
import sys
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from uniart_jax.cli.arguments import Out, Overwrite, check_options, check_out, shard_numbers
from uniart_jax.config import World

if TYPE_CHECKING:
    from uniart_jax.data.folder import Settings
    from uniart_jax.data.sources import Entry
    from uniart_jax.data.splits import Rule


SHARED = ("source", "root", "out", "processes")  # what every source takes
DRAWN = ("procedural", "layouts")  # sources that need no files
# What metadata.json holds as it is given (``data.folder.Settings``).
STORED = (
    *("start_seed", "resolution", "subdivisions", "max_parts", "views", "states", "part_scale"),
    *("shard_size", "strict", "allow_outside", "front", "orbit_views", "orbit_size"),
)
RECORDS = (  # options of every source of records
    *("count", "resolution", "subdivisions", "max_parts", "views", "image_size", "states"),
    *("part_scale", "orbit_views", "orbit_size", "shard", "shard_size", "runner", "beam_options"),
    "part_features",
)
ASSETS = (*RECORDS, "split", "split_list", "strict", "allow_outside", "front")
OPTIONS = {
    "procedural": (*RECORDS, "start_seed", "families", "world"),
    "partnet-mobility": ASSETS,
    "urdf": ASSETS,
    "layouts": ("count", "first_block", "world", "image_size"),
}


def prepare(
    source: Annotated[
        Literal["procedural", "partnet-mobility", "urdf", "layouts"],
        tyro.conf.Positional,
    ],
    root: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    *,
    out: Out,
    count: int | None = None,
    start_seed: int = 0,
    first_block: int = 0,
    families: tuple[str, ...] | None = None,
    world: World = "seven",
    resolution: int = 32,
    subdivisions: int = 4,
    max_parts: int = 16,
    views: int = 2,
    image_size: int | None = None,
    states: int = 1,
    part_scale: float = 0.0,
    orbit_views: int = 0,
    orbit_size: int = 518,
    split: Literal["none", "holdout", "closed", "open"] = "none",
    split_list: Path | None = None,
    strict: bool = False,
    allow_outside: bool = False,
    front: Literal["-x", "+x", "-y", "+y"] = "-x",
    shard: str = "0/1",
    shard_size: int = 64,
    processes: int | None = None,
    runner: Literal["local", "beam"] = "local",
    beam_options: str = "",
    part_features: Literal["none", "geometric"] = "none",
) -> None:
    """Make training records. Can be killed and run again: finished shards are kept.

    Args:
        source: "layouts": pictures and part tables of procedural objects, for --stage layout,
          without voxels; of the options --count, --first-block, --world, --image-size and
          --processes.
          "procedural": drawn here. "partnet-mobility": its folders under ROOT. "urdf": every URDF,
            MJCF and object.json under ROOT.
        root: Folder of assets.
        count: Objects (default: procedural 1000, else all).
        start_seed: procedural: seed of the first object; seeds from 1,000,000 on are held out and
          never trained on.
        first_block: layouts: number of the first block of 256 objects (--data.first-block of a
          training).
        families: procedural: which families, in turn, in place of a world's.
        world: procedural, layouts: "seven": the paper's seven seen categories. "wide": half of the
          objects are of those, half of the other families that are trained on. "detailed": a third
          of each and of families as varied as real furniture. "everyday": a quarter of each of
          these and of other things of a household; "household": half of those; "open": an eighth
          of random assemblies too (docs/data.md).
        resolution: Voxels a side.
        subdivisions: Sub-cells a voxel side.
        max_parts: Objects with more parts are left out.
        views: Rendered images a record, from random front views.
        image_size: Pixels a side of each picture (default: 128; layouts: 256).
        states: Shown states an object.
        part_scale: Stretch parts at random, by about this share, in every state but the first (.1
          is plausible).
        orbit_views: Pictures from all around a record, for `uniart features` (TRELLIS: 150).
        orbit_size: Pixels a side of those.
        split: Names each object's split. "holdout": a tenth is test. "closed": so in the paper's
          seven categories; "open": other large ones are unseen.
        split_list: JSON with "train" and "test" names (SINGAPO's or CAGE's list).
        strict: Leave out objects that lost a mesh or a texture.
        allow_outside: Let assets name files outside their own folders.
        front: Which way the assets face in their own frame (ours and PartNet-Mobility's: -x; many
          robots' furniture: +x).
        shard: "i/n": this run is number i (from 0) of n that share OUT.
        shard_size: Objects a shard.
        processes: Worker processes (default: one a core).
        runner: "beam": by Apache Beam (pip install 'uniart_jax[beam]').
        beam_options: Options of the Beam pipeline, as one string.
        part_features: "geometric": also the column "part_feature", of the shape around each voxel,
          as `uniart features --part-features geometric` makes it.
    """
    given = dict(locals())
    part = shard_numbers(shard)
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"prepare: --{name} must be at least 1, got {value}")
    if first_block < 0:
        raise ValueError(f"prepare: --first-block must be at least 0, got {first_block}")
    usual = signature(prepare).parameters
    asked = [name for name, value in given.items() if value != usual[name].default]
    check_options("prepare", source, [name for name in asked if name not in SHARED], OPTIONS)
    if families is not None and world != "seven":
        raise ValueError("prepare: --world is instead of --families; give one of them")
    if root is not None and source in DRAWN:
        raise ValueError(f"prepare {source}: it takes no ROOT; its objects are drawn")
    workers = processes or max(2, os.cpu_count() or 1)  # one would be this process itself
    if source == "layouts":
        _prepare_layouts(out, count or 1000, world, image_size, workers, first_block)
        return
    from uniart_jax.data import prepare as records
    from uniart_jax.data.folder import Settings

    stored = {name: given[name] for name in STORED}
    settings = Settings(
        source=source,
        root="" if root is None else str(root),
        image_size=128 if image_size is None else image_size,
        **stored,
    )
    if source == "procedural":
        from uniart_jax.procedural import WORLDS

        drawn = WORLDS[world] if families is None else families
        entries, settings = records.procedural_entries(settings, count or 1000, drawn)
    else:
        entries, settings = _asset_entries(settings, root, count, split, split_list)
    run = None
    if runner == "beam":
        from uniart_jax.data.beam import check_beam, run_beam

        check_beam()
        run = functools.partial(run_beam, options=shlex.split(beam_options))
    records.prepare(out, entries, settings, processes=workers, part=part, run=run)
    if part_features == "geometric":
        from uniart_jax.precompute.features import write_geometric_features

        write_geometric_features(out, part=part)


def _prepare_layouts(
    out: Path, count: int, world: World, image_size: int | None, workers: int, first_block: int
) -> None:
    from uniart_jax.data.layouts import LayoutSettings, prepare_layouts
    from uniart_jax.procedural import WORLDS

    settings = LayoutSettings(families=WORLDS[world])
    if image_size is not None:
        settings = dataclasses.replace(settings, image_size=image_size)
    prepare_layouts(out, count, settings, workers, first_block)


def _asset_entries(
    settings: Settings, root: Path | None, count: int | None, split: Rule, split_list: Path | None
) -> tuple[list[Entry], Settings]:
    """The first ``count`` assets below ``root``, each with its split, and the settings that name
    the rule."""
    if root is None:
        source = settings.source
        raise ValueError(
            f"prepare: give the folder of assets: uniart prepare {source} ROOT --out OUT"
        )
    from uniart_jax.data import sources, splits

    found, listed = sources.find_entries(root, settings.source), None
    if split_list is not None:
        listed, warned = splits.read_list(split_list)
        for line in warned:
            print(f"warning: {line}", file=sys.stderr)
    entries = splits.assign(found, split, listed)[:count]
    return entries, dataclasses.replace(settings, split=splits.rule_digest(split, split_list))


def features(
    records: Annotated[Path, tyro.conf.Positional],
    /,
    weights: Path | None = None,
    part_features: Path | None = None,
    export_points: Path | None = None,
    views: int | None = None,
    batch: int = 8,
    shard: str = "0/1",
) -> None:
    """Add features of voxels to prepared records, as columns beside them. Can be killed and run
    again: finished shards are kept.

    Args:
        records: A folder made by ``uniart prepare`` (for --weights: with --orbit-views).
        weights: image_encoder.safetensors of ``uniart convert dinov2``, or its folder: the column
          "visual", DINOv2's features averaged over the orbit.
        part_features: Folder of PartField's results on the exported points: the column
          "part_feature". Or the word "geometric": the shape around each voxel, which needs no
            weights.
        export_points: Folder to write one PLY a record to, for PartField.
        views: --weights: orbit pictures to use of each record (default: all).
        batch: --weights: pictures the network reads at a time.
        shard: "i/n": this run is number i (from 0) of n that share RECORDS.
    """
    part = shard_numbers(shard)
    if weights is None and part_features is None and export_points is None:
        raise ValueError("features: give --weights, --part-features or --export-points")
    from uniart_jax.precompute import features as columns
    from uniart_jax.runtime.compilation_cache import enable_compilation_cache

    if export_points is not None:
        columns.export_points(records, export_points, part=part)
    if part_features == Path(columns.GEOMETRIC):
        columns.write_geometric_features(records, part=part)
    elif part_features is not None:
        columns.write_part_features(records, part_features, part=part)
    if weights is not None:
        enable_compilation_cache()
        columns.write_visual(records, weights, views=views, batch=batch, part=part)


def inspect(
    records: Annotated[Path, tyro.conf.Positional],
    /,
    index: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(help="Folder to write.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Show a record: its views, its voxels in the parts' colours with axes and limits (record.png),
    and the asset that they make.

    Args:
        records: A folder made by `uniart prepare`.
        index: Which record.
        out: Folder to write (default: out/record-INDEX).
    """
    out = out or Path("out") / f"record-{index}"
    check_out(out, overwrite)
    from uniart_jax.data.records import RecordSource
    from uniart_jax.evaluation.inspection import draw_record, part_lines
    from uniart_jax.evaluation.reconstruction import object_of_record

    source = RecordSource(records)
    if not 0 <= index < len(source):
        raise ValueError(f"inspect: --index {index} is outside 0..{len(source) - 1}")
    record = source[index]
    obj = object_of_record(record)
    folder = obj.save(out, image=record.images[0], overwrite=overwrite)
    draw_record(record, obj).save(folder / "record.png")
    print("\n".join(part_lines(record)))
    print(f"{record.meta.get('id', 'record')} -> {folder / 'record.png'}", file=sys.stderr)


def stats(records: Annotated[Path, tyro.conf.Positional], /) -> None:
    """Print what a folder of records holds: counts by category, split and joint type, ranges,
    repairs and errors by kind.

    Args:
        records: A folder made by `uniart prepare`.
    """
    from uniart_jax.data.card import data_card
    from uniart_jax.data.folder import read_manifest

    print(data_card(records, read_manifest(records)))
