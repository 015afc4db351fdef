"""How large things are: an image does not tell, and neither do data sets whose objects are
normalised.

``TYPICAL`` is the longest side in metres of a usual one, closed, by category: our own families (the
median of their seeds) and PartNet-Mobility's categories (``model_cat``) from everyday measures.
Anything else is taken as 1 m. ``--size`` is of the shown state, ``typical_scale`` of
the closed one. Of the seven families' objects (validation seeds) it is off by
a factor of 1.07 (dishwashers) to 1.31 (storage furniture; medians), 1 m by 1.09 to 1.7.
"""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np

from uniart_jax.objects.object import ArticulatedObject, bounds_at

DEFAULT = 1.0  # metres
TYPICAL: dict[str, float] = {
    "storagefurniture": 1.25,
    "table": 1.25,
    "refrigerator": 1.7,
    "dishwasher": 0.85,
    "oven": 0.9,
    "washer": 0.9,
    "washingmachine": 0.9,
    "microwave": 0.5,
    "toilet": 0.75,
    "laptop": 0.35,
    "trashcan": 0.7,
    "bottle": 0.25,
    "swivelchair": 1.0,
    "chair": 1.0,
    "foldingchair": 0.9,
    "scissors": 0.2,
    "faucet": 0.35,
    "barbecue": 1.0,
    "box": 0.4,
    "slidingwindow": 1.3,
    "toolcabinet": 0.85,
    "trolley": 0.75,
    "casementwindow": 1.5,
    "desklamp": 0.6,
    "assemblies": 0.4,
    "desk": 1.25,
    "cupboard": 1.0,
    "cooker": 0.9,
    "builtinappliance": 0.7,
    "coldappliance": 1.6,
    "window": 1.3,
    "door": 2.1,
    "bucket": 0.35,
    "camera": 0.15,
    "cart": 1.0,
    "clock": 0.35,
    "coffeemachine": 0.4,
    "contactgrill": 0.3,
    "dispenser": 0.25,
    "display": 0.6,
    "eyeglasses": 0.15,
    "fan": 0.6,
    "globe": 0.4,
    "jar": 0.18,
    "kettle": 0.25,
    "keyboard": 0.45,
    "kitchenpot": 0.3,
    "knife": 0.2,
    "lamp": 0.6,
    "letterbox": 0.5,
    "lighter": 0.08,
    "mouse": 0.12,
    "pen": 0.15,
    "phone": 0.15,
    "pliers": 0.2,
    "pocketknife": 0.12,
    "printer": 0.45,
    "recordplayer": 0.4,
    "remote": 0.18,
    "safe": 0.5,
    "stapler": 0.15,
    "stool": 0.55,
    "suitcase": 0.7,
    "switch": 0.1,
    "toaster": 0.35,
    "usb": 0.06,
    "valve": 0.7,
    "wallswitch": 0.2,
}

WIDEST = {"refrigerator": 0.8, "coldappliance": 0.8}  # metres, of a body whose height varies


def typical_size(category: str) -> float:
    """Metres of the longest side that an object of ``category`` usually has; 1 where the category
    is unknown."""
    return TYPICAL.get(_key(category), DEFAULT)


def typical_scale(obj: ArticulatedObject, category: str) -> float:
    """Metres for an object unit, with which an object is as long at rest as one of ``category``
    usually is, and no wider than ``WIDEST``; 1 where the category is unknown."""
    key = _key(category)
    if key not in TYPICAL:
        return 1.0
    boxes = bounds_at(obj, obj.rest())
    scale = TYPICAL[key] / float(np.ptp(boxes.reshape(-1, 3), axis=0).max())
    width = float(np.ptp(boxes[0], axis=0)[1])
    return min(scale, WIDEST[key] / width) if key in WIDEST and width else scale


def parse_size(text: str) -> float:
    """The metres that ``--size`` means: a number, or a category of ``TYPICAL``.

    Raises:
      ValueError: neither.
    """
    if _key(text) in TYPICAL and not re.search(r"\d", text):
        return TYPICAL[_key(text)]
    try:
        size = float(text)
    except ValueError:
        known = ", ".join(sorted(TYPICAL))
        raise ValueError(f"--size '{text}': give metres, or a category: {known}") from None
    if not (math.isfinite(size) and 1e-3 <= size <= 1e3):
        raise ValueError(f"--size {text}: the longest side must be between 0.001 and 1000 metres")
    return size


def resized(obj: ArticulatedObject, size: float) -> ArticulatedObject:
    """The object with a longest side of ``size`` metres at the shown state; only ``scale``
    changes."""
    lo, hi = obj.bounds
    return dataclasses.replace(obj, scale=size / float((hi - lo).max()))


def _key(category: str) -> str:
    return re.sub(r"[^a-z]", "", category.lower())
