"""Quality against cost of the solvers of both flows: Euler and Heun in fixed steps, and adaptive at several tolerances.

    python benchmarks/solvers.py --count 32 --out out/bench
    python benchmarks/solvers.py --count 32 --tolerances 0.3 0.1 0.03     the tolerances of docs/benchmarks.md, both solvers

Held-out procedural objects, one view, the same noise for every solver. ``structure``: overlap of the sampled active voxels with the true ones. ``found`` and
``right``: moving parts, from latents sampled on the true active voxels, assembled and compared as ``uniart evaluate`` does; ``readings``: right under the true
segmentation (``training.metrics``). Velocities (network calls) and seconds are means an object of each flow. All objects are padded to one shape, and the
network alone is compiled: solvers run step by step around it, so that the table needs one program a flow; the seconds are those of its calls.

Shares of parts are of all moving parts of all objects. ``+-``: half of a 95 % interval (Student's t) of the difference to ``BASE``, over objects, of the same
figure: an object with more moving parts counts more, one without none. NaN with fewer than two objects.

Expected: the supplement offers adaptive Euler and Heun without figures; of a flow that is near straight, no gain over few fixed steps.
Hardware and time: any device; not yet measured, the run of docs/benchmarks.md was cut short after four objects.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from results import save
from scipy import stats

from uniart_jax.config import Config
from uniart_jax.evaluation.parts import compare_parts
from uniart_jax.evaluation.procedural import HeldOut, held_out
from uniart_jax.flow.guidance import guide
from uniart_jax.flow.solvers import solve
from uniart_jax.models.flow_transformer import T_MIN
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.segments import voxel_plans
from uniart_jax.pipeline import Pipeline, enable_compilation_cache, load, voxel_grid
from uniart_jax.samplers import pad_coords
from uniart_jax.training.metrics import part_readings
from uniart_jax.voxels.assemble import assemble
from uniart_jax.voxels.grid import faired, occupancy
from uniart_jax.voxels.joint_code import NETWORK_TOLERANCE

STEPS = (1, 2, 4, 8, 16)
TOLERANCES = {"euler": (1.0, 0.3, 0.1), "heun": (0.3, 0.1, 0.03)}
BASE = "euler 4"  # the shipped model's own
LEVEL = 0.95


def settings(tolerances: dict[str, tuple[float, ...]]) -> dict[str, dict[str, Any]]:
    """Rows of the table: their name and what ``Flow.sample`` is told."""
    fixed = {f"{s} {n}": {"solver": s, "steps": n} for s in tolerances for n in STEPS}
    return fixed | {
        f"{s} adaptive {tolerance:g}": {"solver": s, "steps": 4, "tolerance": tolerance}
        for s, own in tolerances.items()
        for tolerance in own
    }


class Flow:
    """A guided velocity as one compiled program, and the time its calls took."""

    def __init__(self, name: str, config: Config):
        network, self.name = build(f"{name}_flow", config.model), name
        options = getattr(config, f"sample_{name}")
        self.rescale_t = options.rescale_t
        data = getattr(config.model, f"{name}_flow").prediction == "data"
        self.end, self.seconds = T_MIN if data else 0.0, 0.0

        @jax.jit
        def run(params, x, t, condition, voxels):
            def velocity(x, t, seen):
                return network.apply(params, x, t, seen.tokens, seen.volume, **voxels)

            nothing = jax.tree.map(jnp.zeros_like, condition)
            interval = options.guidance_interval
            return guide(velocity, condition, nothing, options.guidance, interval)(x, t)

        self.run, self.warm = run, False

    def sample(self, params, noise, condition, voxels, valid, solver, steps, tolerance=None):
        """(x at t = 0, velocities asked for)."""
        if not self.warm:  # compile
            self.run(params, noise, jnp.ones(len(noise)), condition, voxels)
            self.warm = True

        def velocity(x, t):
            t = jnp.broadcast_to(jnp.asarray(t, jnp.float32), len(x))
            begin = time.perf_counter()
            with jax.disable_jit(False):
                v = jax.block_until_ready(self.run(params, x, t, condition, voxels))
            self.seconds += time.perf_counter() - begin
            return v

        with jax.disable_jit():  # loops of the solvers as loops of Python
            done = solve(
                velocity,
                noise,
                solver,
                steps,
                self.rescale_t,
                tolerance=tolerance,
                valid=valid,
                end=self.end,
            )
        return done.x, int(done.evaluations[0])


class Bench:
    """The networks of a checkpoint on objects padded to one shape."""

    def __init__(self, pipeline: Pipeline, settings: dict[str, dict[str, Any]]):
        self.pipeline, self.config, self.settings = pipeline, pipeline.config, settings
        pipeline.parameters |= jax.device_put(pipeline.parameters)
        self.flows = {name: Flow(name, pipeline.config) for name in ("structure", "latent")}
        vae = build("uniart_vae", self.config.model)
        self.decode = jax.jit(lambda params, z, batch: vae.apply(params, z, batch, method="decode"))

    def measure(self, test: HeldOut, seed: int) -> dict[str, dict[str, Any]]:
        """Figures of every setting for one object."""
        pipeline, model = self.pipeline, self.config.model
        condition = pipeline.encode_images(pipeline.prepare(test.image)[None])
        keys = jax.random.split(jax.random.key(seed))
        vae = model.structure_vae
        side = model.grid.resolution // vae.patch_size // 2 ** (len(vae.channels) - 1)
        noise = jax.random.normal(keys[0], (1, side, side, side, vae.latent_channels))
        most = max(self.config.data.voxel_buckets)
        coords, counts = pad_coords([test.grid.coords], (most,))
        cells = (model.grid.resolution // model.latent_flow.patch_size) ** 3
        plan = flow_plan(coords, counts, model.latent_flow, model.grid, round_to=cells)
        voxels = {"coords": coords, "counts": counts, "plan": plan}
        valid = (jnp.arange(most) < counts[:, None])[..., None]
        spots = jax.random.normal(keys[1], (1, most, model.uniart_vae.latent_channels)) * valid
        truth = occupancy(test.grid.coords, test.grid.resolution)
        rows = {}
        for name, setting in self.settings.items():
            row: dict[str, Any] = {}
            for flow, start, more, mask in (
                ("structure", noise, {}, None),
                ("latent", spots, voxels, valid),
            ):
                runner = self.flows[flow]
                params = pipeline.parameters[f"{flow}_flow"]
                runner.seconds = 0.0
                x, row[f"{flow} velocities"] = runner.sample(
                    params, start, condition, more, mask, **setting
                )
                row[f"{flow} s"] = runner.seconds
                mean, std = pipeline.statistics[flow]
                if flow == "structure":
                    found = pipeline.active_voxels(x * std + mean)[0]
                    guess = occupancy(found, test.grid.resolution)
                    row["structure"] = float((guess & truth).sum() / (guess | truth).sum())
                else:
                    latent = jnp.where(valid, x * std + mean, 0)
                    row |= self.parts(latent, coords, counts, test)
            rows[name] = row
        return rows

    def parts(self, latent, coords, counts, test: HeldOut) -> dict[str, Any]:
        """Booleans a moving part: found, right, and right under the true segmentation."""
        model, options = self.config.model, self.config.sample_latent
        batch = {"coords": coords, "counts": counts}
        batch["plans"] = voxel_plans(batch, model.uniart_vae, model.grid, parts=False)
        out = jax.device_get(self.decode(self.pipeline.parameters["uniart_vae"], latent, batch))
        count, truth = int(counts[0]), test.grid
        grid = voxel_grid(out, 0, truth.coords, model.grid)
        obj = assemble(
            faired(grid, options.sdf_offset, options.sdf_blur), tolerance=NETWORK_TOLERANCE
        )
        scores = compare_parts(obj, test.obj)
        readings = part_readings(
            out["joint_code"][0, :count],
            out["box_pair"][0, :count, 0],
            truth.voxel_part,
            truth.boxes,
            truth.codes,
            truth.parents,
        )
        return {
            "found": scores.found[scores.moving].tolist(),
            "right": scores.right[scores.moving].tolist(),
            "readings": [row["right"] for row in readings],
        }


def interval(totals: np.ndarray, base: np.ndarray, parts: np.ndarray) -> float:
    """Half of a 95 % interval of ``totals.sum() / parts.sum()`` minus the same of ``base``, over objects; NaN where it is not known.

    Args:
      totals, base: [n] sum of a figure over an object's parts. parts: [n] how many it has; 1 where the figure is the object's own.
    """
    n, apart = len(parts), totals - base
    if n < 2 or not parts.sum():
        return float("nan")
    # a ratio of two means, linearised: what an object adds beyond its share
    beyond = (apart - apart.sum() / parts.sum() * parts) / parts.mean()
    return float(stats.t.ppf((1 + LEVEL) / 2, n - 1) * beyond.std(ddof=1) / n**0.5)


def table(objects: list[dict[str, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row a setting: means over objects (structure, cost) and over all moving parts."""
    rows = []
    base = [o[BASE] for o in objects]
    for name in objects[0]:
        of = [o[name] for o in objects]
        row: dict[str, Any] = {"solver": name}
        row["structure"] = float(np.mean([r["structure"] for r in of]))
        ours, theirs = (np.array([r["structure"] for r in both]) for both in (of, base))
        row["structure +-"] = interval(ours, theirs, np.ones(len(of)))
        for figure in ("found", "right", "readings"):
            values = [value for r in of for value in r[figure]]
            row[figure] = float(np.mean(values)) if values else float("nan")
        ours, theirs = (np.array([float(sum(r["right"])) for r in both]) for both in (of, base))
        row["right +-"] = interval(ours, theirs, np.array([len(r["right"]) for r in of]))
        for figure in ("structure velocities", "latent velocities", "structure s", "latent s"):
            row[figure] = float(np.mean([r[figure] for r in of]))
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=32, help="held-out objects")
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument(
        "--tolerances",
        type=float,
        nargs="+",
        help="of both adaptive solvers, instead of each one's own",
    )
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    args = parser.parse_args()
    enable_compilation_cache()
    tolerances = (
        dict.fromkeys(TOLERANCES, tuple(args.tolerances)) if args.tolerances else TOLERANCES
    )
    bench = Bench(load(args.checkpoint), settings(tolerances))
    objects = []
    for k in range(args.count):
        begin = time.perf_counter()
        objects.append(bench.measure(held_out(k), k))
        save("solvers", table(objects), args.out, objects=k + 1)  # long: what is there can be read
        print(f"object {k + 1} of {args.count}: {time.perf_counter() - begin:.0f} s", flush=True)
    rows = table(objects)
    print("| " + " | ".join(rows[0]) + " |\n|" + "---|" * len(rows[0]))
    for row in rows:
        cells = (f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values())
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
