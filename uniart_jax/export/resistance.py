"""Friction and damping that somebody asks for, instead of what ``export.dynamics`` makes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from uniart_jax.export.frames import joint_chain, joint_names, moves
from uniart_jax.export.physics import Body, Dynamics
from uniart_jax.objects.object import ArticulatedObject

Resistance = float | Mapping[str, float]


def parse_resistance(option: str, words: Sequence[str]) -> Resistance | None:
    """What stands behind ``--friction`` or ``--damping``: one factor, or JOINT=VALUE for each joint
    that is meant; None of no words.

    Raises:
      ValueError: anything else, a joint named twice, or a number that is negative or not finite.
    """
    if not words:
        return None
    if len(words) == 1 and "=" not in words[0]:
        factor = _number(option, words[0], words[0])
        check_resistance(option, factor)
        return factor
    values: dict[str, float] = {}
    for word in words:
        name, equals, value = word.rpartition("=")
        if not equals or not name:
            raise ValueError(
                f"--{option} '{word}': give one factor for all joints, or JOINT=VALUE for each"
            )
        if name in values:
            raise ValueError(f"--{option}: joint '{name}' is given twice; give it once")
        values[name] = _number(option, word, value)
    check_resistance(option, values)
    return values


def check_resistance(
    option: str, given: Resistance | None, obj: ArticulatedObject | None = None
) -> None:
    """Refuse (ValueError) numbers that are negative or not finite and, of an object that is given,
    joints that it does not have."""
    if given is None:
        return
    named = given if isinstance(given, Mapping) else {"": given}
    for name, value in named.items():
        if not (math.isfinite(value) and value >= 0):
            of = f" of joint '{name}'" if name else ""
            raise ValueError(f"--{option}{of}: give a finite number of 0 or more, got {value:g}")
    if obj is None or not isinstance(given, Mapping):
        return
    names = [name for part in obj.parts for name in joint_names(part)]
    if unknown := [name for name in given if name not in names]:
        there = ", ".join(names) or "none"
        raise ValueError(f"--{option}: no joint is called '{unknown[0]}'; there are: {there}")


def resisting(
    obj: ArticulatedObject,
    bodies: Sequence[Body],
    friction: Resistance | None = None,
    damping: Resistance | None = None,
) -> tuple[Body, ...]:
    """The bodies with friction and damping as asked for, the same in every format.

    Args:
      obj: any object. bodies: [K] of its parts, with the dynamics of all joints.
      friction, damping: a factor on those of every joint, or numbers by the joint's name in the
        files: N m and N m s / rad of a joint that turns, N and N s / m of one that travels. What a
        joint is given holds with and without a spring; joints that are not named keep theirs.

    ``start`` and ``falls`` follow; effort grows with friction, by five times as much.

    Raises:
      ValueError: no joint of that name, or a number that is negative or not finite.
    """
    check_resistance("friction", friction, obj)
    check_resistance("damping", damping, obj)
    chains = [
        joint_chain(part, body) if moves(part) else []
        for part, body in zip(obj.parts, bodies, strict=True)
    ]
    changed = []
    for body, chain in zip(bodies, chains, strict=True):
        own: list[Dynamics] = []
        for link in chain:
            dynamics = _rubbing(link.dynamics, link.name, friction)
            value = _changed(dynamics.damping, link.name, damping)
            dynamics = dataclasses.replace(dynamics, damping=value)
            if link.first:
                body = dataclasses.replace(body, dynamics=dynamics)
            else:
                own.append(dynamics)
        changed.append(dataclasses.replace(body, further=tuple(own)))
    return tuple(changed)


def _rubbing(dynamics: Dynamics, name: str, given: Resistance | None) -> Dynamics:
    """With other friction, and what follows from it."""
    if given is None or (isinstance(given, Mapping) and name not in given):
        return dynamics
    friction = _changed(dynamics.friction, name, given)
    alone = _changed(dynamics.alone, name, given)
    start = dynamics.start
    if start is not None:
        start = max(0.0, start + (friction - dynamics.friction) / dynamics.lever)
    return dataclasses.replace(
        dynamics,
        friction=friction,
        unsprung=alone,
        effort=dynamics.effort + 5 * max(0.0, alone - dynamics.alone),
        start=start,
        falls=alone < dynamics.load,
    )


def _changed(value: float, name: str, given: Resistance | None) -> float:
    if isinstance(given, Mapping):
        return float(given.get(name, value))
    return value if given is None else value * given


def _number(option: str, word: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"--{option} '{word}': '{text}' is no number; give one factor, or JOINT=VALUE"
        ) from None
