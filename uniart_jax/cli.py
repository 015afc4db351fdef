"""Command lines: ``uniart …``, ``train.py`` and ``sample.py``.

Every mistake a user can make ends in one line on stderr and exit code 2. Heavy imports happen inside the commands.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import os
import shlex
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from uniart_jax.config import NETWORKS, Config

Stage = Literal[
    "all", "image_encoder", "structure_vae", "uniart_vae", "structure_flow", "latent_flow"
]
Out = Annotated[Path, tyro.conf.arg(help="Folder to write.")]
Overwrite = Annotated[
    bool, tyro.conf.arg(help="Replace OUT if it is not empty (swapped at the end).")
]


def guarded(command: Callable[[], int | None]) -> int:
    """Run a command; user errors become one line and exit code 2, Ctrl-C becomes 130."""

    def show(message, category, filename, lineno, file=None, line=None):
        if issubclass(category, UserWarning):
            print(f"warning: {message}", file=sys.stderr)

    warnings.showwarning = show
    try:
        return command() or 0
    except (ValueError, OSError, ArithmeticError, MemoryError) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        print(f"error: {message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130


def sample(
    images: Annotated[tuple[Path, ...], tyro.conf.Positional],
    /,
    out: Out,
    checkpoint: str = "nano",
    seed: int = 0,
    num_samples: int = 1,
    steps: int | None = None,
    guidance: float | None = None,
    multi_view: bool = False,
    overwrite: Overwrite = False,
) -> None:
    """One image in, a complete articulated object out.

    Args:
        images: Image files. With an alpha channel or a plain background the object is cut out by itself.
        checkpoint: "nano" (shipped), a folder written by training, or a training WORKDIR.
        seed: Same seed, same object.
        num_samples: Samples an image.
        steps: Solver steps of both flows (default: the checkpoint's).
        guidance: Classifier-free guidance of both flows, 0 = none (default: the checkpoint's).
        multi_view: The images are views of one object.
    """
    if not images:
        raise ValueError("sample: give at least one image file")
    if not 0 <= seed < 2**31:
        raise ValueError(f"sample: --seed must be in 0..{2**31 - 1}, got {seed}")
    if num_samples < 1:
        raise ValueError(f"sample: --num-samples must be at least 1, got {num_samples}")
    if steps is not None and steps < 1:
        raise ValueError(f"sample: --steps must be at least 1, got {steps}")
    from uniart_jax.data.images import check_visible, read_image

    pictures = [read_image(path) for path in images]  # all inputs are checked before any work
    for path, picture in zip(images, pictures, strict=True):
        check_visible(picture, f"image '{path}'")
    folders = sample_folders(images, out, num_samples, multi_view)
    for folder in folders.values():
        check_out(folder, overwrite, images)
    from uniart_jax.pipeline import enable_compilation_cache, load

    enable_compilation_cache()
    console = Console(stderr=True)
    with console.status("loading the model") as status:
        pipeline = load(checkpoint)
        groups = [("object", list(zip(images, pictures, strict=True)))]
        if not multi_view:
            groups = [
                (path.name, [(path, picture)])
                for path, picture in zip(images, pictures, strict=True)
            ]
        for g, (name, views) in enumerate(groups):
            for i in range(num_samples):
                status.update(f"{name}: sample {i + 1} of {num_samples}")
                obj = pipeline(
                    [picture for _, picture in views],
                    seed=seed + i,
                    steps=steps,
                    guidance=guidance,
                    name=views[0][0].stem,
                    progress=lambda step, name=name: status.update(f"{name}: {step}"),
                )
                folder = folders[g, i]
                obj.save(
                    folder,
                    image=views[0][1],
                    seed=seed + i,
                    checkpoint=checkpoint,
                    overwrite=overwrite,
                )
                moving = [p.joint.type for p in obj.parts if p.joint.type != "fixed"]
                kinds = (
                    ", ".join(f"{moving.count(t)} {t}" for t in sorted(set(moving)))
                    or "no moving joint"
                )
                console.print(
                    f"{name}: {len(obj.parts)} parts ({kinds}) -> {folder}", highlight=False
                )


def check_out(folder: Path, overwrite: bool, inputs: tuple[Path, ...] = ()) -> None:
    """Refuse, before any work, an output folder that cannot be written or that holds an input.

    Raises:
      ValueError: it or a parent is a file, or it is not empty and may not be replaced.
    """
    from uniart_jax.export.asset import check_target

    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            raise ValueError(f"output '{place}': a file of that name exists; choose another --out")
    check_target(folder, overwrite, inputs=inputs)


def sample_folders(
    images, out: Path, num_samples: int, multi_view: bool
) -> dict[tuple[int, int], Path]:
    """(image or group, sample) -> folder: OUT itself for one object, else OUT/<stem>/sample-<i>.

    Raises:
      ValueError: two images have the same stem, so that their folders would be the same.
    """
    groups = images[:1] if multi_view else images
    if len(groups) == 1 and num_samples == 1:
        return {(0, 0): Path(out)}
    stems = [Path(p).stem for p in groups]
    if len(set(stems)) != len(stems):
        repeated = next(s for s in stems if stems.count(s) > 1)
        raise ValueError(
            f"sample: two images are called '{repeated}'; rename one, their folders would be the same"
        )
    return {
        (g, i): Path(out) / stem / f"sample-{i}"
        for g, stem in enumerate(stems)
        for i in range(num_samples)
    }


def load_config(path: Path) -> Config:
    """The ``config()`` of a configs/*.py file.

    Raises:
      FileNotFoundError, ValueError: no such file, or it has no function ``config`` that returns a ``Config``.
    """
    if not path.is_file():
        raise FileNotFoundError(f"config '{path}': no such file; see configs/")
    spec = importlib.util.spec_from_file_location("uniart_config", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"config '{path}': not a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        config = module.config() if hasattr(module, "config") else None
    except Exception as error:  # the user's own code
        raise ValueError(f"config '{path}': {type(error).__name__}: {error}") from error
    if not isinstance(config, Config):
        raise ValueError(
            f"config '{path}': it must define config() returning a uniart_jax.config.Config"
        )
    return config


@dataclasses.dataclass
class TrainArguments:
    """Train one stage or all of them; resumes by itself if WORKDIR holds checkpoints."""

    config: Path
    """A file in configs/."""
    stage: Stage = "all"
    """Which network; 'all' runs them in order, encoding latents between."""
    workdir: Path | None = None
    """Where checkpoints, logs and the export go (default: runs/<config name>)."""
    init: str | None = None
    """A checkpoint ("nano", a folder) to go on from: the stage begins with its weights, the other networks are taken as they are."""


def train(arguments: list[str]) -> None:
    """Parse ``--config`` and friends, then any field of the config by its dotted name, and train."""
    # with a config given, --help belongs to its fields
    fields = "--config" in " ".join(arguments) and bool({"-h", "--help"} & set(arguments))
    first = [a for a in arguments if not (fields and a in ("-h", "--help"))]
    known, rest = tyro.cli(TrainArguments, args=first, return_unknown_args=True, prog="train.py")
    rest += ["--help"] if fields else []
    default = load_config(known.config)
    config = tyro.cli(Config, default=default, args=rest, prog="train.py --config …")
    from uniart_jax.pipeline import enable_compilation_cache
    from uniart_jax.stages import run

    enable_compilation_cache()
    stages = NETWORKS if known.stage == "all" else (known.stage,)
    run(config, stages, known.workdir or Path("runs") / config.name, known.init)


def prepare(
    source: Annotated[Literal["procedural", "partnet-mobility", "urdf"], tyro.conf.Positional],
    root: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    *,
    out: Out,
    count: int | None = None,
    start_seed: int = 0,
    families: tuple[str, ...] | None = None,
    resolution: int = 32,
    subdivisions: int = 4,
    max_parts: int = 16,
    views: int = 2,
    image_size: int = 128,
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
) -> None:
    """Make training records. Can be killed and run again: finished shards are kept.

    Args:
        source: "procedural": drawn here. "partnet-mobility": its folders under ROOT. "urdf": every URDF, MJCF and object.json under ROOT.
        root: Folder of assets.
        count: Objects (default: procedural 1000, else all).
        start_seed: procedural: seed of the first object; seeds from 1,000,000 on are held out and never trained on.
        families: procedural: which families (default: all that are trained on).
        resolution: Voxels a side.
        subdivisions: Sub-cells a voxel side.
        max_parts: Objects with more parts are left out.
        views: Rendered images a record, from random front views.
        image_size: Pixels a side.
        states: Shown states an object.
        part_scale: Stretch parts at random, by about this share, in every state but the first (.1 is plausible).
        orbit_views: Pictures from all around a record, for `uniart features` (TRELLIS: 150).
        orbit_size: Pixels a side of those.
        split: Names each object's split. "holdout": a tenth is test. "closed": so in the paper's seven categories; "open": other large ones are unseen.
        split_list: JSON with "train" and "test" names (SINGAPO's or CAGE's list).
        strict: Leave out objects that lost a mesh or a texture.
        allow_outside: Let assets name files outside their own folders.
        front: Which way the assets face in their own frame (ours and PartNet-Mobility's: -x; many robots' furniture: +x).
        shard: "i/n": this run is number i (from 0) of n that share OUT.
        shard_size: Objects a shard.
        processes: Worker processes (default: one a core).
        runner: "beam": by Apache Beam (pip install 'uniart_jax[beam]').
        beam_options: Options of the Beam pipeline, as one string.
    """
    from uniart_jax.data import prepare as records
    from uniart_jax.data.folder import Settings

    part = _part(shard)
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"prepare: --{name} must be at least 1, got {value}")
    if source != "procedural" and (families is not None or start_seed):
        raise ValueError("prepare: --families and --start-seed are of procedural objects")
    workers = processes or max(2, os.cpu_count() or 1)  # one would be this process itself
    run = None
    if runner == "beam":
        from uniart_jax.data.beam import check_beam, run_beam

        check_beam()
        run = functools.partial(run_beam, options=shlex.split(beam_options))
    settings = Settings(
        source=source,
        start_seed=start_seed,
        root="" if root is None else str(root),
        resolution=resolution,
        subdivisions=subdivisions,
        max_parts=max_parts,
        views=views,
        image_size=image_size,
        states=states,
        part_scale=part_scale,
        shard_size=shard_size,
        strict=strict,
        allow_outside=allow_outside,
        front=front,
        orbit_views=orbit_views,
        orbit_size=orbit_size,
    )
    if source == "procedural":
        if root is not None or split != "none" or split_list is not None:
            raise ValueError("prepare: procedural objects have no ROOT and no --split; their seeds and families are their split")  # fmt: skip
        entries, settings = records.procedural_entries(settings, 1000 if count is None else count, families)  # fmt: skip
    else:
        if root is None:
            raise ValueError(f"prepare: give the folder of assets: uniart prepare {source} ROOT --out OUT")  # fmt: skip
        from uniart_jax.data import sources, splits

        found = sources.find_entries(root, source)
        listed = None
        if split_list is not None:
            listed, warned = splits.read_list(split_list)
            for line in warned:
                print(f"warning: {line}", file=sys.stderr)
        entries = splits.assign(found, split, listed)[:count]
        settings = dataclasses.replace(settings, split=splits.rule_digest(split, split_list))
    records.prepare(out, entries, settings, processes=workers, part=part, run=run)


def _part(text: str) -> tuple[int, int]:
    """ "i/n" as two numbers."""
    number, slash, of = text.partition("/")
    if not (slash and number.isdecimal() and of.isdecimal() and int(number) < int(of)):
        raise ValueError(f"--shard must be i/n with i in 0..n-1, got '{text}'")
    return int(number), int(of)


def reconstruct(
    asset: Annotated[Path, tyro.conf.Positional],
    /,
    out: Out,
    resolution: int = 32,
    subdivisions: int = 4,
    allow_outside: bool = False,
    overwrite: Overwrite = False,
) -> None:
    """Object -> voxels -> object without any network: what the representation itself can hold.

    Args:
        asset: A URDF file, or a folder with one.
        resolution: Voxels a side.
        subdivisions: Sub-cells a voxel side.
        allow_outside: Let the URDF name meshes outside its own folder.
    """
    check_out(out, overwrite, (asset,))
    if not 1 <= resolution <= 256 or not 1 <= subdivisions <= 8:
        raise ValueError(
            f"reconstruct: --resolution must be in 1..256 and --subdivisions in 1..8, got {resolution}, {subdivisions}"
        )
    from uniart_jax.evaluation.reconstruction import reconstruct_asset

    reconstruct_asset(
        asset, out, resolution, subdivisions, allow_outside=allow_outside, overwrite=overwrite
    )


def evaluate(
    what: Annotated[Literal["procedural", "representation"], tyro.conf.Positional],
    root: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    *,
    out: Out,
    checkpoint: str = "nano",
    count: int | None = None,
    records: Path | None = None,
    pictures: int = 16,
    unseen: bool = False,
    processes: int | None = None,
    allow_outside: bool = False,
) -> None:
    """Measure a checkpoint on held-out procedural objects (or the representation alone) and write a table and pictures.

    Args:
        what: "procedural": image to object. "representation": truth to voxels to object, no network.
        root: representation: a folder of assets, measured at 32 and 64 voxels a side, instead of procedural objects.
        checkpoint: As for sample.py.
        count: Held-out objects, seeds from 1,000,000 on (default 128), or assets (default all).
        records: Training records for the retrieval baseline; without them it is left out.
        pictures: How many objects are drawn.
        unseen: The families that are never trained on, instead of the trained ones.
        processes: Worker processes beside the networks' own (default: one a core, at most 8).
        allow_outside: representation: let assets name files outside their own folders.
    """
    for name, value in (("count", count), ("processes", processes)):
        if value is not None and value < 1:
            raise ValueError(f"evaluate: --{name} must be at least 1, got {value}")
    if out.exists() and not out.is_dir():
        raise ValueError(f"output '{out}': a file of that name exists; choose another --out")
    workers = processes or min(os.cpu_count() or 1, 8)
    if root is not None:
        if what != "representation":
            raise ValueError("evaluate: a folder of assets goes with 'representation'; it has no images")  # fmt: skip
        from uniart_jax.evaluation.assets import evaluate_assets

        evaluate_assets(root, out, count=count, processes=workers, allow_outside=allow_outside)
        return
    from uniart_jax.evaluation import procedural
    from uniart_jax.pipeline import enable_compilation_cache

    enable_compilation_cache()
    share: dict[str, Any] = {
        "unseen": unseen,
        "processes": workers,
    }
    if what == "representation":
        procedural.evaluate_representation(out, count=count or 128, **share)
    else:
        procedural.evaluate_checkpoint(
            checkpoint, out, count=count or 128, records=records, pictures=pictures, **share
        )


def inspect(
    records: Annotated[Path, tyro.conf.Positional],
    /,
    index: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(help="Folder to write.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Show a record: its views, its voxels in the parts' colours with axes and limits (record.png), and the asset that they make.

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
    """Print what a folder of records holds: counts by category, split and joint type, ranges, repairs and errors by kind.

    Args:
        records: A folder made by `uniart prepare`.
    """
    from uniart_jax.data.card import data_card
    from uniart_jax.data.folder import read_manifest

    print(data_card(records, read_manifest(records)))


def convert(
    kind: Annotated[Literal["trellis", "dinov2"], tyro.conf.Positional],
    path: Annotated[Path, tyro.conf.Positional],
    /,
    out: Annotated[Path, tyro.conf.arg(help="Folder to write; 'dinov2': the file, or its folder.")],
    overwrite: Overwrite = False,
) -> None:
    """Make a checkpoint of published weights, to sample with or to train on from. Nothing is downloaded and nothing unpickled.

    Args:
        kind: "trellis": a folder with <name>.json and <name>.safetensors, or with them in ckpts. "dinov2": a file of dinov2_vit{s,b,l}14_reg.
        path: The folder or file.
    """
    from uniart_jax.conversion import convert_dinov2_file, convert_trellis_folder

    (convert_trellis_folder if kind == "trellis" else convert_dinov2_file)(path, out, overwrite)


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
    """Add features of voxels to prepared records, as columns beside them. Can be killed and run again: finished shards are kept.

    Args:
        records: A folder made by ``uniart prepare`` (for --weights: with --orbit-views).
        weights: image_encoder.safetensors of ``uniart convert dinov2``, or its folder: the column "visual", DINOv2's features averaged over the orbit.
        part_features: Folder of PartField's results on the exported points: the column "part_feature".
        export_points: Folder to write one PLY a record to, for PartField.
        views: --weights: orbit pictures to use of each record (default: all).
        batch: --weights: pictures the network reads at a time.
        shard: "i/n": this run is number i (from 0) of n that share RECORDS.
    """
    part = _part(shard)
    if weights is None and part_features is None and export_points is None:
        raise ValueError("features: give --weights, --part-features or --export-points")
    from uniart_jax import features as columns
    from uniart_jax.pipeline import enable_compilation_cache

    if export_points is not None:
        columns.export_points(records, export_points, part=part)
    if part_features is not None:
        columns.write_part_features(records, part_features, part=part)
    if weights is not None:
        enable_compilation_cache()
        columns.write_visual(records, weights, views=views, batch=batch, part=part)


COMMANDS = {
    "prepare": prepare,
    "features": features,
    "sample": sample,
    "reconstruct": reconstruct,
    "evaluate": evaluate,
    "inspect": inspect,
    "stats": stats,
    "convert": convert,
}


def main() -> None:
    """The ``uniart`` program."""
    if sys.argv[1:2] == ["train"]:
        sys.exit(guarded(lambda: train(sys.argv[2:])))
    sys.exit(
        guarded(
            lambda: tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                prog="uniart",
                description="Articulated 3D objects from one image. Also: uniart train …",
            )
        )
    )


def sample_main() -> None:
    """``sample.py``."""
    sys.exit(guarded(lambda: tyro.cli(sample, prog="sample.py")))


def train_main() -> None:
    """``train.py``."""
    sys.exit(guarded(lambda: train(sys.argv[1:])))
