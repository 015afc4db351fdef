"""Fits the network that gives colours to what a picture does not show
(``export/hidden_colors.py``), and says how far its colours are off.

    python tools/fit_hidden_colors.py OUT [--made 448] [--plain 8192] [--validation 64]
        [--checkpoint nano] [--steps 6000] [--write]

Fitted to places of two kinds, of procedural training objects of the detailed world: on objects that
the checkpoint makes of their pictures, where a place has the colour of the true surface beside it;
and on the true objects themselves, where there is no decoder's colour. The first are few, since one
takes about 7 s; the second are many. The figures are of objects of validation seeds that the
checkpoint makes: mean absolute differences of sRGB in 0..1. ``--write`` puts the weights into the
package; ``--steps 0`` judges those that are there. OUT keeps the places, a file for each ``BLOCK``
objects, and a run goes on where it stopped. 512 made objects take an hour on one core, the rest ten
minutes.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import trimesh
from safetensors.numpy import save
from scipy.spatial import cKDTree

from uniart_jax import procedural
from uniart_jax.config import DataConfig
from uniart_jax.evaluation.procedural import sample_state
from uniart_jax.evaluation.result_store import check_settings
from uniart_jax.evaluation.summary import interval
from uniart_jax.export import hidden_colors as network
from uniart_jax.export.hidden_colors import Places, described, with_normals
from uniart_jax.export.picture_colors import SEEN, look
from uniart_jax.objects.appearance import corner_weights, linear_to_srgb, sample_color
from uniart_jax.objects.object import ArticulatedObject
from uniart_jax.pipeline import Pipeline, load
from uniart_jax.runtime.compilation_cache import enable_compilation_cache
from uniart_jax.runtime.files import complete
from uniart_jax.runtime.progress import track
from uniart_jax.visual.render import build_scene, occluded, render, sample_camera
from uniart_jax.voxels.camera_code import camera_position

BLOCK = 64  # objects a file
TRUE_SEED, MADE_SEED = 500_000, 600_000  # first ones; validation seeds begin at 900,000
SIDE = 256  # pixels of a picture
PLACES, ASKED = 2048, 256  # of an object, and hidden ones of them that are learned from
TRUE = 40_000  # places of the true surface
BESIDE, ALIKE = 0.03, 0.7  # object units, and cosine of normals, to the true surface
FACING = 0.15  # cosine from which on a true place is seen
BURIED = 0.003  # object units in front of a true place that must be free
WRONG = 0.05  # share of seen places with another's colour, as beside an edge
WIDTH, LAYERS = 64, 3  # of the perceptron
BATCH, MADE = 32, 0.5  # objects, and share of them that the checkpoint made
RATE, DECAY, WARM = 3e-3, 0.02, 100  # steps
BRIGHTER, LOST, UNDECODED = 0.1, 0.05, 0.1  # of a step's objects, candidates, and decoders


class Rows(NamedTuple):
    """[n, 256] places: features, candidates, which there are, and the true colours, sRGB."""

    features: np.ndarray
    colors: np.ndarray
    there: np.ndarray
    true: np.ndarray


def surface(
    obj: ArticulatedObject, count: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """About ``count`` places on an object at its shown state, evenly, but a quarter of them as many
    on each part: points, normals [n, 3], parts [n], linear RGB [n, 3]."""
    area = np.array([part.mesh.area for part in obj.parts])
    share = area / area.sum() + 0.25 / len(area)
    rows = []
    for k, (part, n) in enumerate(zip(obj.parts, share / share.sum() * count, strict=True)):
        mesh = part.mesh
        points, face = trimesh.sample.sample_surface(mesh, max(int(n), 16), seed=rng)
        color = sample_color(mesh, face, corner_weights(mesh.triangles[face], points))
        rows.append((points, mesh.face_normals[face], np.full(len(face), k), color))
    points, normals, parts, colors = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = rng.permutation(len(points))
    return points[order], normals[order], parts[order], colors[order]


def shown_object(family: str, seed: int) -> tuple[ArticulatedObject, Any, np.random.Generator]:
    """An object at a random state, and a camera."""
    rng = np.random.default_rng([seed, 7])
    obj = sample_state(procedural.generate(family, seed), rng)
    return obj, sample_camera(rng), rng


def of_made(pipeline: Pipeline, family: str, seed: int) -> Rows | None:
    """Places on the object that a checkpoint makes of a picture; None where too few are known."""
    obj, camera, rng = shown_object(family, seed)
    image = np.round(255 * render(obj, camera, size=SIDE, samples=4)).astype(np.uint8)
    made = pipeline.sample(image, seed=seed)
    if made.picture is None:
        return None
    points, normals, parts, decoded = (a[:PLACES] for a in surface(made.obj, 1.2 * PLACES, rng))
    shown, belief = look(made.picture, made.obj, points, normals)
    there, facing, _, color = surface(obj, TRUE, rng)
    tree = cKDTree(with_normals(there, facing, network.TURNED))
    distance, near = tree.query(with_normals(points, normals, network.TURNED))
    known = (distance < BESIDE) & ((facing[near] * normals).sum(-1) > ALIKE)
    places = Places(points, normals, parts, _srgb(decoded), _srgb(shown), belief > SEEN)
    asked = np.flatnonzero(~places.seen & known)
    position = camera_position(made.picture.camera)
    return _rows(places, made.obj, position, asked, _srgb(color[near]), rng)


def of_true(family: str, seed: int) -> Rows | None:
    """Places on a true object, of which a camera sees some; None where too few are left."""
    obj, camera, rng = shown_object(family, seed)
    points, normals, parts, color = surface(obj, 1.5 * PLACES, rng)
    scene = build_scene(obj)[0]
    start = (points + 1e-4 * normals).astype(np.float32)
    hit = scene.run(start, normals.astype(np.float32), output=1)
    free = np.flatnonzero((hit["primID"] < 0) | (hit["tfar"] > BURIED))[:PLACES]
    points, normals, parts, color = points[free], normals[free], parts[free], _srgb(color[free])
    towards = camera.position - points
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    start = (points + 2e-4 * normals).astype(np.float32)
    seen = (normals * towards).sum(-1) > FACING
    seen &= ~occluded(scene, start, towards.astype(np.float32))
    shown, rows = color.copy(), np.flatnonzero(seen)
    wrong = rows[rng.random(len(rows)) < WRONG]
    shown[wrong] = color[rng.choice(rows, len(wrong))] if len(wrong) else shown[wrong]
    places = Places(points, normals, parts, None, shown, seen)
    return _rows(places, obj, camera.position, np.flatnonzero(~seen), color, rng)


def _rows(
    places: Places,
    obj: ArticulatedObject,
    camera: np.ndarray,
    asked: np.ndarray,
    true: np.ndarray,
    rng: np.random.Generator,
) -> Rows | None:
    if places.seen.sum() < 60 or len(asked) < ASKED // 4:
        return None
    at = rng.choice(asked, ASKED, replace=len(asked) < ASKED)
    return Rows(*described(places, obj, camera, at), true[at])


def _srgb(linear: np.ndarray) -> np.ndarray:
    return linear_to_srgb(np.clip(linear, 0, 1))


def blocks(
    out: Path, kind: str, count: int, first: int, make: Callable[[str, int], Rows | None]
) -> Rows:
    """Rows of ``count`` objects from seed ``first`` on, kept in files of OUT."""
    families, rows = procedural.WORLDS["detailed"], []
    starts = range(first, first + count, BLOCK)
    for start in track(starts, f"{kind} objects", len(starts), unit="blocks"):
        path = out / f"{kind}-{start}.npz"
        if not path.is_file():
            seeds = range(start, min(start + BLOCK, first + count))
            found = [make(families[seed % len(families)], seed) for seed in seeds]
            columns = zip(*(row for row in found if row is not None), strict=True)
            stacked = Rows(*(np.stack(column) for column in columns))
            with complete(path) as part, part.open("wb") as file:
                np.savez(file, allow_pickle=False, **stacked._asdict())
        with np.load(path) as held:
            rows.append(Rows(*(held[name] for name in Rows._fields)))
    return Rows(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def fit(made: Rows, true: Rows, steps: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Weights as ``hidden_colors.weighed`` takes them."""
    rng = np.random.default_rng(seed)
    flat = made.features.reshape(-1, made.features.shape[-1])
    scale = {"mean": flat.mean(0), "deviation": flat.std(0) + 0.05}
    count = made.colors.shape[2]
    sides = [flat.shape[1] + 4 * count, *[WIDTH] * LAYERS, count + 1 + 3]
    weights = {}
    for k, (into, out) in enumerate(itertools.pairwise(sides)):
        spread = np.sqrt((1.5 if k < LAYERS else 0.1) / into)
        weights[f"kernel_{k}"] = (spread * rng.normal(size=(into, out))).astype(np.float32)
        weights[f"bias_{k}"] = np.zeros(out, np.float32)

    def loss(weights: Any, rows: Rows, key: jax.Array) -> jax.Array:
        keys = jax.random.split(key, 4)
        objects = (len(rows.true), 1)
        gain = jnp.exp(BRIGHTER * jax.random.normal(keys[0], objects))
        with_decoder = jax.random.bernoulli(keys[1], 0.5, objects)
        gains = jnp.tile(gain[..., None], (1, 1, count))
        gains = gains.at[..., network.DECODER].set(jnp.where(with_decoder, gain, 1.0))
        colors = jnp.clip(rows.colors * gains[..., None], 0, 1)
        true = jnp.clip(rows.true * gain[..., None], 0, 1)
        there = rows.there & ~jax.random.bernoulli(keys[2], LOST, (*objects, count))
        undecoded = jax.random.bernoulli(keys[3], UNDECODED, objects)
        there = there.at[..., network.DECODER :].set(
            there[..., network.DECODER :] & ~undecoded[..., None]
        )
        features, colors, there = (
            a.reshape(-1, *a.shape[2:]) for a in (rows.features, colors, there)
        )
        said = network.weighed(features, colors, there, weights | scale, jnp)
        return jnp.abs(said - true.reshape(-1, 3)).mean()

    schedule = optax.warmup_cosine_decay_schedule(0, RATE, WARM, steps)
    clip = optax.clip_by_global_norm(1.0)
    transform = optax.chain(clip, optax.adamw(schedule, weight_decay=DECAY))
    state = transform.init(weights)

    @jax.jit
    def step(weights: Any, state: Any, rows: Rows, key: jax.Array) -> tuple[Any, Any, jax.Array]:
        value, gradient = jax.value_and_grad(loss)(weights, rows, key)
        update, state = transform.update(gradient, state, weights)
        return optax.apply_updates(weights, update), state, value

    mine = int(MADE * BATCH)
    for k in track(range(steps), "fit", steps, unit="steps"):
        drawn = (
            (kind, rng.choice(len(kind.true), n))
            for kind, n in ((made, mine), (true, BATCH - mine))
        )
        rows = [Rows(*(column[picked] for column in kind)) for kind, picked in drawn]
        batch = Rows(*(np.concatenate(column) for column in zip(*rows, strict=True)))
        weights, state, _ = step(weights, state, batch, jax.random.key(k))
    return scale | jax.device_get(weights)


def errors(rows: Rows, weights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """[n] mean absolute differences of sRGB in 0..1, an object each: of the decoder's colours, the
    nearest seen place's, and what the network says."""
    said = [network.weighed(*row[:3], weights) for row in zip(*rows, strict=True)]
    nearest = np.where(
        rows.there[..., :1],
        rows.colors[..., network.NEAREST, :],
        rows.colors[..., network.OTHERS, :],
    )
    found = {
        "decoder": rows.colors[..., network.DECODER, :],
        "nearest": nearest,
        "network": np.stack(said),
    }
    return {name: np.abs(color - rows.true).mean((1, 2)) for name, color in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--made", type=int, default=448, help="objects that the checkpoint makes")
    parser.add_argument("--plain", type=int, default=8192, help="true objects")
    parser.add_argument("--validation", type=int, default=64, help="made objects, of other seeds")
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--write", action="store_true", help="put the weights into the package")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    counts = {name: getattr(args, name) for name in ("made", "plain", "validation")}
    settings = {"checkpoint": args.checkpoint, **counts}
    check_settings(args.out, settings, "another checkpoint or other counts")
    enable_compilation_cache()
    pipeline = load(args.checkpoint)

    def make(family: str, seed: int) -> Rows | None:
        return of_made(pipeline, family, seed)

    validation = blocks(args.out, "made", args.validation, DataConfig.validation_seed, make)
    if args.steps:
        true = blocks(args.out, "true", args.plain, TRUE_SEED, of_true)
        weights = fit(blocks(args.out, "made", args.made, MADE_SEED, make), true, args.steps)
    else:
        weights = network._weights()
    weights = {name: np.asarray(value, np.float16) for name, value in weights.items()}
    found = errors(validation, {name: value.astype(np.float32) for name, value in weights.items()})
    for name, off in found.items():
        low, high = interval(off)
        print(f"{name}: {off.mean():.3f} [{low:.3f}, {high:.3f}] of {len(off)} objects")
    if args.write:
        with complete(Path(network.__file__).parent / network.WEIGHTS) as part:
            part.write_bytes(save(weights))


if __name__ == "__main__":
    main()
