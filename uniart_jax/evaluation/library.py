"""A folder of assets as a library to retrieve from: PartNet-Mobility's, or any URDF, MJCF or
``object.json`` below it. ``evaluation.retrieval`` takes its parts, or the whole asset that looks
most like an image.

    ROOT -> assets -> parts at rest (``retrieval.make_library``)
                   -> ``VIEWS`` pictures of each, at states and from cameras as those of records

Textured assets take seconds a picture, so pictures are kept, a PNG an asset, and taken again from
there; remove the folder when assets change. States and cameras are functions of the asset's path
below ROOT.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from uniart_jax.data.folder import Settings
from uniart_jax.data.sources import Entry, find_entries, load_entry
from uniart_jax.evaluation.metric import at_rest
from uniart_jax.evaluation.runner import run_or_reason
from uniart_jax.objects.facing import check_front
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.objects.states import sample_state
from uniart_jax.runtime.files import complete
from uniart_jax.runtime.progress import messages
from uniart_jax.visual.render import render, sample_camera

VIEWS = 4  # pictures an asset, as prepared records have
console = messages()


@dataclasses.dataclass(frozen=True)
class Asset:
    """One asset of a library, read where it is needed.

    Attributes:
      root: the library. path: of the asset, relative to it.
      front, allow_outside: as ``data.folder.Settings`` has them.
    """

    root: str
    path: str
    front: str = "-x"
    allow_outside: bool = False

    def load(self) -> ArticulatedObject:
        """The asset as it is, in metres, turned so that its front is at -x.

        Raises:
          ValueError, FileNotFoundError: it cannot be read.
        """
        settings = Settings(
            "urdf", root=self.root, front=self.front, allow_outside=self.allow_outside
        )
        return load_entry(self._entry, settings)

    def at_rest(self) -> ArticulatedObject:
        """The asset at rest, its longest side 1 and ``scale`` 1: as large as all that is made from
        images."""
        return dataclasses.replace(at_rest(self.load()), scale=1.0)

    def pictures(self, size: int) -> np.ndarray:
        """[VIEWS, size, size, 4] uint8 straight-alpha renderings, each at a state of its own."""
        closed, rng = self.load(), self._entry.generator(1)
        shown = (
            render(sample_state(closed, rng), sample_camera(rng), size=size, samples=4)
            for _ in range(VIEWS)
        )
        return np.stack([np.round(picture * 255).astype(np.uint8) for picture in shown])

    @property
    def _entry(self) -> Entry:
        return Entry(self.path, "", path=self.path)


def find_assets(root: Path, *, front: str = "-x", allow_outside: bool = False) -> list[Asset]:
    """The assets below a folder, sorted by path.

    Raises:
      FileNotFoundError: no such folder, or none in it. ValueError: no such front.
    """
    check_front(front, "library: front")
    if not Path(root).is_dir():
        raise FileNotFoundError(f"library '{root}': no such folder")
    try:
        entries = find_entries(root, "urdf")
    except FileNotFoundError:
        raise FileNotFoundError(
            f"library '{root}': no URDF, MJCF or object.json in it or below it"
        ) from None
    return [Asset(str(root), entry.path, front, allow_outside) for entry in entries]


def library_pictures(
    assets: Sequence[Asset], cache: Path, size: int, processes: int = 1
) -> Iterator[tuple[Asset, np.ndarray]]:
    """Each asset that can be shown and its pictures [VIEWS, size, size, 4] uint8, made by
    ``processes`` workers where ``cache`` does not hold them.

    Raises:
      ValueError: none can be shown.
    """
    cache.mkdir(parents=True, exist_ok=True)
    show = functools.partial(_show, cache, size)
    made = run_or_reason(show, assets, "library pictures", processes=processes)
    return good_ones(assets, made)


def good_ones(assets: Sequence[Asset], results: Iterable[Any]) -> Iterator[tuple[Asset, Any]]:
    """Assets with their results, but for those whose result is a reason (text); these are told.

    Raises:
      ValueError: nothing is left.
    """
    bad = []
    for asset, result in zip(assets, results, strict=True):
        if isinstance(result, str):
            bad.append(result)
        else:
            yield asset, result
    if not bad:
        return
    told = f"{len(bad)} of {len(assets)} assets cannot be used, the first because: {bad[0]}"
    told = f"library '{assets[0].root}': {told}"
    if len(bad) == len(assets):
        raise ValueError(told)
    console.print(told, markup=False, soft_wrap=True)


def _show(cache: Path, size: int, asset: Asset) -> np.ndarray:
    file = cache / f"{asset.path.replace('/', '+')}{asset.front}-{size}.png"
    if file.is_file():
        with Image.open(file) as kept:
            strip = np.asarray(kept)
    else:
        strip = np.concatenate(asset.pictures(size), 1)
        with complete(file) as partial:
            Image.fromarray(strip).save(partial, "PNG")
    return strip.reshape(size, VIEWS, size, 4).swapaxes(0, 1)
