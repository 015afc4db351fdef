"""``uniart export | validate | view | reconstruct | convert``: assets and checkpoints that exist
already."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Annotated, Literal

import tyro

from uniart_jax.cli.arguments import (
    Out,
    Overwrite,
    check_out,
    folder_lines,
    gate_lines,
    run_physics_checks,
    validation_lines,
)
from uniart_jax.cli.asset_options import AS_USUAL, Output
from uniart_jax.runtime.progress import messages, track

Asset = Annotated[Path, tyro.conf.Positional]


def export(
    asset: Asset,
    /,
    out: Out,
    output: Output = AS_USUAL,
    refine: bool = False,
    check: bool = True,
    allow_outside: bool = False,
    overwrite: Overwrite = False,
) -> int:
    """Write anybody's object as an asset that simulators load as it is: collision shapes, masses,
    limits, every format.

    Args:
        asset: A URDF, an MJCF, SINGAPO's object.json, or a folder with one.
        refine: Draw in limits and shift axes where a joint runs into the object.
        check: Try it in the physics engines that are installed (report.json says how it went).
        allow_outside: Let the asset name files outside its own folder.
    """
    options = output.parsed()
    check_out(out, overwrite, (asset,))
    from uniart_jax.export.asset import save_asset
    from uniart_jax.export.size import typical_size
    from uniart_jax.objects.load import load_object
    from uniart_jax.simulation.refine import mend

    obj = load_object(asset, allow_outside=allow_outside)
    if options["size"] is None and not is_metric(asset, allow_outside):
        options["size"] = typical_size(obj.category)
    found: list[dict] = []
    console = messages()
    with console.status("collision shapes, textures, physics"):
        save_asset(
            obj,
            out,
            **options,
            overwrite=overwrite,
            mend=mend if refine else None,
            check=(lambda folder: run_physics_checks(folder, found)) if check else None,
        )
    for line in json.loads((out / "report.json").read_text("utf-8"))["notes"]:
        console.print(f"note: {line}", markup=False)
    for line in validation_lines(found[0]) if found else ():
        console.print(line, markup=False)
    console.print(f"{obj.name or asset.stem}: {len(obj.parts)} parts -> {out}", markup=False)
    return 0


def is_metric(asset: Path, allow_outside: bool) -> bool:
    """Whether a file's lengths are metres: PartNet-Mobility's and SINGAPO's objects are
    normalised."""
    from uniart_jax.objects.load import find_asset, kind_of

    path = find_asset(asset, allow_outside=allow_outside)
    return kind_of(path.read_bytes(), path) in ("urdf", "mjcf")


def validate(
    asset: Asset,
    /,
    out: Annotated[
        Path | None, tyro.conf.arg(help="Folder to write (default: out/validation/NAME).")
    ] = None,
    engines: tuple[Literal["mujoco", "pybullet"], ...] | None = None,
    refine: bool = False,
    gate: Literal["affordcraft"] | None = None,
    allow_outside: bool = False,
    overwrite: Overwrite = False,
) -> int:
    """Load an asset in physics engines, drive its joints, judge it. Exit code 0 if it is sound, 1
    if not, 2 if it cannot be read.

    Args:
        asset: A URDF, an MJCF, or a folder with object.urdf (ours or anybody's). --gate: or a
          folder of many.
        engines: Default: MuJoCo and, where it is installed, PyBullet (pip install
          'uniart_jax[pybullet]').
        refine: Also write the object with joints drawn in or shifted where they run into it, to
          OUT/refined, and judge that.
        gate: Judge it by this published rule instead, in MuJoCo (docs/simulation.md).
        allow_outside: Let the asset name files outside its own folder.
    """
    if gate is not None and (refine or engines not in (None, ("mujoco",))):
        raise ValueError(
            "validate: --gate judges a file as it is, in MuJoCo: leave out --refine and --engines"
        )
    if out is None:  # ours to replace
        name = asset.resolve().parent.name if asset.stem == "object" else asset.resolve().stem
        out, overwrite = Path("out") / "validation" / (name or "asset"), True
    check_out(out, overwrite, (asset,), VALIDATION_MARKS)
    from uniart_jax.export.folder import complete_folder
    from uniart_jax.simulation import validate as simulation
    from uniart_jax.simulation.gate_folder import assets_below, gate_folder
    from uniart_jax.simulation.summary import is_sound, verdicts

    console = messages()
    if gate is not None and (entries := assets_below(asset)):
        bar = functools.partial(track, what=f"gate {gate}", total=len(entries))
        with complete_folder(out, overwrite, VALIDATION_MARKS) as folder:
            judged = gate_folder(
                asset, name=gate, out=folder, allow_outside=allow_outside, track=bar
            )
        for line in folder_lines(judged):
            print(line)
        console.print(f"{asset} -> {out}", markup=False)
        return 0 if judged["passed"] == len(judged["assets"]) else 1
    if gate is not None:
        with complete_folder(out, overwrite, VALIDATION_MARKS) as folder:
            judged = simulation.gate(asset, name=gate, out=folder, allow_outside=allow_outside)
        for line in gate_lines(judged["gate"]):
            print(line)
        console.print(f"{asset} -> {out}", markup=False)
        return 0 if judged["gate"]["passed"] else 1
    with (
        complete_folder(out, overwrite, VALIDATION_MARKS) as folder,
        console.status("loading, sweeping, driving"),
    ):
        found = simulation.validate(asset, out=folder, engines=engines, allow_outside=allow_outside)
        if refine:
            from uniart_jax.objects.load import load_object
            from uniart_jax.simulation.refine import mend

            obj = load_object(asset, allow_outside=allow_outside)
            obj.save(folder / "refined", motion=False, mend=mend)
            notes = json.loads((folder / "refined" / "report.json").read_text("utf-8"))["notes"]
            after = simulation.validate(folder / "refined", out=folder / "refined", engines=engines)
    for line in validation_lines(verdicts(found)):
        print(line)
    for engine, why in found["not_run"].items():
        print(f"{engine}: not run ({why})")
    if refine:
        for line in [n for n in notes if n.startswith("refine:")]:
            print(line)
        print("refined:")
        for line in validation_lines(verdicts(after)):
            print(line)
        found = after
    console.print(f"{asset} -> {out}", markup=False)
    return 0 if is_sound(found) else 1


VALIDATION_MARKS = ("validation.json",)


def view(asset: Asset, /, browser: bool = True, allow_outside: bool = False) -> None:
    """Open a page with a slider for every joint of an asset, and print where it lies: view.html
    beside the asset, or one that is made for it and removed on Ctrl-C.

    Args:
        asset: A URDF, an MJCF, SINGAPO's object.json, or a folder with one.
        browser: Open it in a browser, if there is a display.
        allow_outside: Let the asset name files outside its own folder.
    """
    from uniart_jax.export.show import show

    show(asset, open_browser=browser, wait=True, allow_outside=allow_outside)


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
            "reconstruct: --resolution must be in 1..256 and --subdivisions in 1..8, got "
            f"{resolution}, {subdivisions}"
        )
    from uniart_jax.evaluation.reconstruction import reconstruct_asset

    reconstruct_asset(
        asset, out, resolution, subdivisions, allow_outside=allow_outside, overwrite=overwrite
    )


def convert(
    kind: Annotated[Literal["trellis", "dinov2", "openshape"], tyro.conf.Positional],
    path: Annotated[Path, tyro.conf.Positional],
    /,
    out: Annotated[Path, tyro.conf.arg(help="Folder to write; 'dinov2': the file, or its folder.")],
    overwrite: Overwrite = False,
) -> None:
    """Make a checkpoint of published weights, to sample with or to train on from. Nothing is
    downloaded and nothing unpickled.

    Args:
        kind: "trellis": a folder with <name>.json and <name>.safetensors, or with them in ckpts.
          "dinov2": a file of dinov2_vit{s,b,l}14_reg. "openshape": a folder with OpenShape's
            model.pt and OpenCLIP's open_clip_model.safetensors, for "uniart evaluate".
        path: The folder or file.
    """
    from uniart_jax.weights import conversion

    converters = {
        "trellis": conversion.convert_trellis_folder,
        "dinov2": conversion.convert_dinov2_file,
        "openshape": conversion.convert_openshape_folder,
    }
    converters[kind](path, out, overwrite)
