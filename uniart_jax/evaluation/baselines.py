"""A checkpoint beside everything it should be compared with, all on one split of held-out
procedural objects.

    model                      image -> object
    nearest_image              image -> the object of the training record whose image is nearest (needs the records)
    nearest_asset              image -> the asset of a library (``evaluation.library``) that looks nearest
    retrieval_true_boxes       boxes, labels, tree and joints of the truth, parts of the library (``evaluation.retrieval``)
    retrieval_predicted_boxes  boxes, tree and joints of the model's object (no labels), parts of the library
    rest_only, mirrored        controls: the truth with a planted mistake (``evaluation.controls``)

With a library of assets its parts take the place of procedural ones in both ``retrieval_…``.
``nearest_image`` is a record's object, assembled from its voxels as the model's is. What networks
make is kept as assets and made once; all else is a function of them and of the split.
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from uniart_jax.config import ModelConfig
from uniart_jax.data.images import PICTURE_SIDE
from uniart_jax.evaluation.compare import compare
from uniart_jax.evaluation.controls import CONTROLS
from uniart_jax.evaluation.library import Asset
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.pairs import Source
from uniart_jax.evaluation.procedural import HeldOut, held_out_for, split_families
from uniart_jax.evaluation.result_store import check_settings, read_result, write_result
from uniart_jax.evaluation.retrieval import (
    make_asset_library,
    make_asset_retrieval,
    make_library,
    make_retrieval,
    retrieve_parts,
    training_objects,
)
from uniart_jax.evaluation.runner import run, run_staged
from uniart_jax.export.asset import save_asset
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.objects.load import load_object
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import load

BASELINE_CONTROLS = ("rest_only", "mirrored")
Objects = Mapping[str, Source]


def evaluate_baselines(
    checkpoint: str,
    out: Path,
    *,
    records: Path | None = None,
    library: Sequence[Asset] = (),
    count: int = 128,
    unseen: bool = False,
    openshape: Path | None = None,
    processes: int = 1,
) -> dict[str, Any]:
    """All methods against the truth, every figure: ``compare`` of ``baseline_methods``. Goes on
    where it was stopped.

    Args:
      openshape: OpenShape's converted weights, as ``compare`` takes them.
    """
    methods, references = baseline_methods(
        checkpoint,
        out,
        records=records,
        library=library,
        count=count,
        unseen=unseen,
        processes=processes,
    )
    return compare(methods, references, Path(out), openshape=openshape, processes=processes)


def baseline_methods(
    checkpoint: str,
    out: Path,
    *,
    records: Path | None = None,
    library: Sequence[Asset] = (),
    count: int = 128,
    unseen: bool = False,
    processes: int = 1,
) -> tuple[dict[str, Objects], Objects]:
    """Every method's objects, and the references, by name (``0003-dishwasher``). Goes on where it
    was stopped.

    Args:
      checkpoint: as for ``pipeline.load``.
      out: a folder; ``objects/<method>/<name>/`` are the assets of ``model`` and ``nearest_image``,
        and ``<name>.json`` says why there is none. A name that a method lacks is a failure of the
        method.
      records: what the checkpoint was trained on; None = no ``nearest_image``.
      library: of ``library.find_assets``; none = no ``nearest_asset``, parts of procedural objects.
      count: held-out objects, of the families that are never trained on if ``unseen``.

    Raises:
      ValueError: the records hold held-out objects, no asset of the library can be used, or objects
        of another checkpoint, split, records or library lie in ``out``.
    """
    folder = Path(out) / "objects"
    check_settings(
        folder,
        {
            "checkpoint": f"{checkpoint} {Checkpoint.find(checkpoint).digest()}",
            "records": str(records or ""),
            "unseen": unseen,
            "picture": PICTURE_SIDE,
            **({"library": _told_apart(library)} if library else {}),
        },
        "another checkpoint, split, records, library or size of pictures",
    )
    model = make_assets(checkpoint, folder, records, library, count, unseen, processes)
    draw = functools.partial(_truth, unseen=unseen, model=model)
    truth: dict[str, ArticulatedObject] = dict(
        run(draw, range(count), "references", processes=processes)
    )
    methods: dict[str, Objects] = {
        method: {name: folder / method / name for name in truth if _is_made(folder, method, name)}
        for method in ("model", *(["nearest_image"] if records else []))
    }
    if library:
        methods["nearest_asset"] = {
            name: Asset(**found["asset"]).at_rest
            for name in truth
            if (found := read_result(_said_of(folder, "nearest_asset", name)))
        }
        parts = make_asset_library(library, processes)
    else:
        parts = make_library(training_objects(), processes)
    methods["retrieval_true_boxes"] = {
        name: retrieve_parts(obj, parts) for name, obj in truth.items()
    }
    methods["retrieval_predicted_boxes"] = {}
    for name in methods["model"]:
        try:
            sampled = load_object(folder / "model" / name)
        except (
            ValueError
        ):  # named among the model's own failures; a name that is absent counts as one
            continue
        target = dataclasses.replace(at_rest(sampled), scale=1.0)
        methods["retrieval_predicted_boxes"][name] = retrieve_parts(target, parts)
    for control in BASELINE_CONTROLS:
        methods[control] = {name: CONTROLS[control](obj) for name, obj in truth.items()}
    return methods, truth


def make_assets(
    checkpoint: str,
    folder: Path,
    records: Path | None,
    library: Sequence[Asset],
    count: int,
    unseen: bool,
    processes: int,
) -> ModelConfig:
    """What networks make of the images: ``folder/model/<name>`` and, given records,
    ``folder/nearest_image/<name>``, where it is missing; given a library, which asset is nearest.

    Networks run in this process, ``processes`` others draw images and write assets. Returns the
    model's settings.
    """
    pipeline = load(checkpoint)
    model = pipeline.config.model
    families = split_families(unseen)
    names = {index: object_name(index, families) for index in range(count)}
    methods = ["model", *(["nearest_image"] if records else [])]
    methods += ["nearest_asset"] if library else []
    missing = {
        method: [i for i in range(count) if not _is_settled(folder, method, names[i])]
        for method in methods
    }
    todo = sorted(set().union(*missing.values()))
    if not todo:
        return model
    retrieve = retrieve_asset = None
    if records and missing["nearest_image"]:
        retrieve = make_retrieval(pipeline, records)
    if library and missing["nearest_asset"]:
        pictures = folder.parent / "library"
        retrieve_asset = make_asset_retrieval(pipeline, library, pictures, processes)

    def from_image(index: int, test: HeldOut) -> list[Callable[[], None]]:
        name, written = names[index], []
        if index in missing["model"]:
            try:
                obj = pipeline(test.image, seed=index, name=name)
                written.append(functools.partial(_write, obj, folder / "model" / name))
            except ValueError as error:  # no object in the image: a failure that counts
                write_result(_said_of(folder, "model", name), {"why": str(error)})
        if retrieve is not None and index in missing["nearest_image"]:
            obj = retrieve(pipeline.prepare(test.image))
            written.append(functools.partial(_write, obj, folder / "nearest_image" / name))
        if retrieve_asset is not None and index in missing["nearest_asset"]:
            asset = retrieve_asset(pipeline.prepare(test.image))
            kept = _said_of(folder, "nearest_asset", name)  # the asset stays where it is
            write_result(kept, {"asset": dataclasses.asdict(asset)})
        return written

    draw = functools.partial(held_out_for, model, unseen=unseen)
    run_staged(draw, from_image, todo, "images to objects", processes=processes)
    return model


def object_name(index: int, families: Sequence[str]) -> str:
    """Of held-out object ``index``: ``0003-dishwasher``."""
    return f"{index:04d}-{families[index % len(families)]}"


def _truth(index: int, unseen: bool, model: ModelConfig) -> tuple[str, ArticulatedObject]:
    """Its longest side 1, as all that is made from images: no image tells a size, and SINGAPO's
    figures would count it."""
    test = held_out_for(model, index, unseen)
    obj = dataclasses.replace(at_rest(test.obj), scale=1.0)
    return object_name(index, split_families(unseen)), obj


def _write(obj: ArticulatedObject, folder: Path) -> None:
    """In the grid's units and place, as large as the truth, whatever size a record's object has."""
    obj = dataclasses.replace(obj, scale=1.0)
    save_asset(obj, folder, formats=(), motion=False, origin=None)


def _said_of(folder: Path, method: str, name: str) -> Path:
    """Why a method has no object; of ``nearest_asset``, which asset it copies."""
    return folder / method / f"{name}.json"


def _told_apart(library: Sequence[Asset]) -> str:
    """What tells one library from another."""
    first = library[0]
    paths = hashlib.blake2b(repr([a.path for a in library]).encode(), digest_size=8).hexdigest()
    return f"{first.root} {first.front} {len(library)} {paths}"


def _is_made(folder: Path, method: str, name: str) -> bool:
    return (folder / method / name / "object.urdf").is_file()


def _is_settled(folder: Path, method: str, name: str) -> bool:
    return _is_made(folder, method, name) or _said_of(folder, method, name).is_file()
