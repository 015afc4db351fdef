"""What every comparison of two objects agrees on: the frame, the states, and how a figure is
called.

A family of figures is one module with ``METRICS: dict[str, Metric]`` and a function of two objects,
both from ``at_rest``, that returns a number for every key. NaN means that there is nothing to
compare (no joint, say) and is left out of means; what a *wrong* prediction gets is a number. A
prediction that is missing or cannot be read counts as ``Metric.worst`` wherever the reference held
against itself has a number.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from uniart_jax.objects.kinematics import Joint
from uniart_jax.objects.object import ArticulatedObject

# 0 is the rest state (RS); articulated states (AS) are the mean over all five, as SINGAPO's code
# has it.
STATES = np.linspace(0.0, 1.0, 5)

Figures = dict[str, float]


@dataclasses.dataclass(frozen=True)
class Metric:
    """One figure.

    Attributes:
      title: for tables, a few characters.
      better: which way is better.
      worst: what a prediction counts as that is missing or cannot be read.
      about: one sentence for the report: what it measures, in which unit.
    """

    title: str
    better: Literal["higher", "lower"]
    worst: float
    about: str


def at_rest(obj: ArticulatedObject) -> ArticulatedObject:
    """The object as all figures see it: every joint at its rest state and measured from there,
    centred, longest side 1.

    Rest and range are each object's own (``ArticulatedObject.rest``, ``open``), so is the scale: an
    image does not tell a size. What turns for ever has no way to open: the largest component of its
    axis is made positive, so that a wheel and the same wheel with its axis reversed are one.
    """
    return resting(obj).normalized()


def resting(obj: ArticulatedObject) -> ArticulatedObject:
    """``at_rest`` in the object's own frame, in metres: what SINGAPO's code is given."""
    obj = obj.single_jointed()  # what lies between two ends of one joint may be an end of another
    obj = obj.shown_at(obj.rest())
    if obj.scale != 1:
        metres = obj.transformed(np.diag([*[obj.scale] * 3, 1.0]))
        obj = dataclasses.replace(metres, scale=1.0)
    parts = tuple(dataclasses.replace(p, joint=_one_way(p.joint)) for p in obj.parts)
    return dataclasses.replace(obj, parts=parts)


def _one_way(joint: Joint) -> Joint:
    direction = joint.direction
    if joint.type != "continuous" or direction[np.abs(direction).argmax()] > 0:
        return joint
    lo, hi = joint.angle
    return dataclasses.replace(joint, direction=-direction, angle=(-hi, -lo))
