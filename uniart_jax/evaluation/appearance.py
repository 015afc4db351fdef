"""How alike two objects look: PSNR and silhouettes of pictures by our own renderer, the same
cameras for both.

The paper says neither views nor background nor how it treats them; here is what is done:

* nine cameras about the object's box centre at rest, distance 3.5 (the longest side at rest is 1),
  40 degrees of view, 112 x 112
  pixels, one ray a pixel: eight around at azimuths 0 (the front, -x), 45, ... 315 degrees, at
    elevations of 10 and 30 degrees by turns,
  and one from above (azimuth 0, elevation 75). No camera follows what opens;
* the renderer's fixed light, a white background, colours in sRGB in [0, 1], not rounded to 8 bits;
* PSNR = -10 log10(mean squared difference over pixels and channels) of each picture, capped at 60
  dB (8 bits cannot show less), then the mean over cameras; RS is state 0, AS the mean over
  ``STATES``;
* ``*_psnr`` is over whole pictures, as the field has it: white on both sides counts, so small and
  thin objects score higher, and figures compare across methods but not across objects.
  ``*_psnr_object`` is over the union of the two silhouettes alone, per picture.

A missing prediction counts as 0 dB, black against white, below which no picture can fall. An empty
picture scores 8 to 28 dB on procedural truths (median 17), more than a dark object in the wrong
place: with that, failing would pay.
"""

from __future__ import annotations

import numpy as np

from uniart_jax.evaluation.materials import uncolored, with_materials
from uniart_jax.evaluation.metric import STATES, Figures, Metric
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.visual.render import Camera, build_scene, render

SIZE = 112
CAP = 60.0
CAMERAS = (
    *(
        Camera(np.deg2rad(45 * i), np.deg2rad(10 if i % 2 == 0 else 30), 40.0, 3.5)
        for i in range(8)
    ),
    Camera(0.0, np.deg2rad(75), 40.0, 3.5),
)

_VIEWS = f"{len(CAMERAS)} fixed views on white"
METRICS = {
    "rs_psnr": Metric("RS PSNR", "higher", 0.0, f"Pictures at rest, {_VIEWS}, dB."),
    "as_psnr": Metric("AS PSNR", "higher", 0.0, f"Pictures over five states, {_VIEWS}, dB."),
    "rs_psnr_object": Metric(
        "RS PSNR obj.", "higher", 0.0, "As RS PSNR, over the union of the two silhouettes, dB."
    ),
    "as_psnr_object": Metric(
        "AS PSNR obj.", "higher", 0.0, "As AS PSNR, over the union of the two silhouettes, dB."
    ),
    "rs_silhouette": Metric(
        "RS sil. IoU", "higher", 0.0, "Overlap of the silhouettes at rest, mean over the views."
    ),
    "as_silhouette": Metric(
        "AS sil. IoU", "higher", 0.0, "Overlap of the silhouettes, mean over views and five states."
    ),
}  # fmt: skip


def measure(pred: ArticulatedObject, ref: ArticulatedObject) -> Figures:
    """The figures of ``METRICS`` for two objects from ``metric.at_rest``.

    A prediction without colours (``materials.uncolored``) is given the truth's first.
    """
    if uncolored(pred):
        pred = with_materials(pred, ref)
    rows = [compare(views(pred, pred.open(s)), views(ref, ref.open(s))) for s in STATES]
    figures = {}
    for column, name in enumerate(("psnr", "psnr_object", "silhouette")):
        figures[f"rs_{name}"] = float(rows[0][column])
        figures[f"as_{name}"] = float(np.mean([row[column] for row in rows]))
    return figures


def views(obj: ArticulatedObject, q: np.ndarray) -> np.ndarray:
    """[9, SIZE, SIZE, 4] pictures from ``CAMERAS`` at state q: sRGB over white and the silhouette
    (0 or 1), float32."""
    scene = build_scene(obj, q)
    rgba = np.stack([render(obj, c, SIZE, q, samples=1, scene=scene) for c in CAMERAS])
    rgba[..., :3] += 1 - rgba[..., 3:]  # a ray hits or not, and colour is 0 where it does not
    return rgba


def compare(pred: np.ndarray, ref: np.ndarray) -> tuple[float, float, float]:
    """(PSNR of whole pictures, PSNR over the union of silhouettes, IoU of silhouettes), means over
    pictures.

    Args:
      pred, ref: [n, h, w, 4] as ``views`` gives them. A picture that shows neither object has no
        silhouette to compare.
    """
    one, other = pred[..., 3] > 0, ref[..., 3] > 0
    union = one | other
    seen = union.any((1, 2))
    whole = psnr(pred[..., :3], ref[..., :3])
    if not seen.any():
        return float(whole.mean()), float("nan"), float("nan")
    masked = psnr(pred[seen, ..., :3], ref[seen, ..., :3], union[seen])
    overlap = (one & other)[seen].sum((1, 2)) / union[seen].sum((1, 2))
    return float(whole.mean()), float(masked.mean()), float(overlap.mean())


def psnr(a: np.ndarray, b: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """[n] peak signal-to-noise ratio of pictures [n, h, w, 3] in [0, 1], dB, at most ``CAP``; over
    the pixels in ``mask`` [n, h, w]."""
    error = np.square(a.astype(np.float64) - b).mean(-1)
    counted = np.ones(error.shape, bool) if mask is None else mask
    mean = (error * counted).sum((1, 2)) / counted.sum((1, 2))
    return -10 * np.log10(np.maximum(mean, 10 ** (-CAP / 10)))
