"""Quality against cost of the solvers of both flows: Euler and Heun in fixed steps, and adaptive at several tolerances.

    python benchmarks/solvers.py --count 32 --out out/bench

Held-out procedural objects, one view, the same noise for every solver. ``structure``: overlap of the sampled active voxels with the true ones. ``found`` and
``right``: moving parts, from latents sampled on the true active voxels, assembled and compared as ``uniart evaluate`` does; ``readings``: right under the true
segmentation (``training.metrics``). Velocities (network calls) and seconds are means an object of each flow. ``+-``: half of a 95 % interval of the mean
difference to ``BASE`` over objects. All objects are padded to one shape, and the network alone is compiled: solvers run step by step around it, so
that the table needs one program a flow; the seconds are those of its calls.
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
SETTINGS: dict[str, dict[str, Any]] = {
    **{f"{s} {n}": {"solver": s, "steps": n} for s in TOLERANCES for n in STEPS},
    **{
        f"{s} adaptive {tolerance:g}": {"solver": s, "steps": 4, "tolerance": tolerance}
        for s, tolerances in TOLERANCES.items()
        for tolerance in tolerances
    },
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

    def __init__(self, pipeline: Pipeline):
        self.pipeline, self.config = pipeline, pipeline.config
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
        for name, setting in SETTINGS.items():
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


def interval(values: list[float], base: list[float]) -> float:
    """Half of a 95 % interval of the mean of ``values - base`` over objects."""
    difference = np.subtract(values, base)
    return float(1.96 * difference.std(ddof=1) / np.sqrt(len(difference))) if len(values) > 1 else 0


def table(objects: list[dict[str, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row a setting: means over objects (structure, cost) and over all moving parts."""
    rows = []
    for name in SETTINGS:
        of = [o[name] for o in objects]
        row: dict[str, Any] = {"solver": name}
        row["structure"] = float(np.mean([r["structure"] for r in of]))
        base = [o[BASE] for o in objects]
        row["structure +-"] = interval([r["structure"] for r in of], [r["structure"] for r in base])
        for figure in ("found", "right", "readings"):
            row[figure] = float(np.mean([value for r in of for value in r[figure]]))
        shares = [[float(np.mean(r["right"])) for r in both] for both in (of, base)]
        row["right +-"] = interval(*shares)
        for figure in ("structure velocities", "latent velocities", "structure s", "latent s"):
            row[figure] = float(np.mean([r[figure] for r in of]))
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=32, help="held-out objects")
    parser.add_argument("--checkpoint", default="nano")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    args = parser.parse_args()
    enable_compilation_cache()
    bench = Bench(load(args.checkpoint))
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
