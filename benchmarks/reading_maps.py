"""Reading a map where boxes are seen: by gathers, as CPUs do it, beside a product with
interpolation weights, in one run; and the time of the layout network's whole gradient with either.

    taskset -c 0 python benchmarks/reading_maps.py [--batch 24] [--repeats 3]

As many places as in nano's training, drawn at random: 15 in each of 16 boxes, in maps of 64 x 64
cells with 96 channels; the network reads them in four runs of its layers. Its gradient is that of
all weights. One core: a product may use several, a scatter uses one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from results import in_turn

from uniart_jax.evaluation.table import markdown
from uniart_jax.models import layout_layers
from uniart_jax.models.checkpoint import Checkpoint
from uniart_jax.models.layout_layers import BOX_POINTS
from uniart_jax.models.network import build
from uniart_jax.nn.lifting import read_map, sample_map_dense

WAYS = {"gathers": jax.vmap(read_map), "product": sample_map_dense}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--batch", type=int, default=24, help="pictures")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    checkpoint = Checkpoint.find("nano")
    model = checkpoint.config.model
    params, network = checkpoint.load("layout"), build("layout", model)
    rng = np.random.default_rng(0)
    size, side = model.layout.image_size, model.layout.image_size // 4
    image = jnp.asarray(rng.random((given.batch, size, size, 3)), jnp.float32)
    camera = jnp.asarray(rng.uniform(0.2, 0.5, (given.batch, 7)), jnp.float32)
    shape = (given.batch, side, side, model.layout.map_channels)
    features = jnp.asarray(rng.standard_normal(shape), jnp.float32)
    shape = (given.batch, model.layout.queries * len(BOX_POINTS), 2)
    places = jnp.asarray(rng.uniform(-0.6, 0.6, shape), jnp.float32)
    always = jnp.ones(given.batch, bool)

    def reading(way: Callable) -> Callable[[], Any]:
        return _compiled(lambda f: way(f, places), features)

    def gradient_of_reading(way: Callable) -> Callable[[], Any]:
        return _compiled(jax.grad(lambda f: jnp.square(way(f, places)).mean()), features)

    def gradient_of_network(way: Callable) -> Callable[[], Any]:
        def loss(params, *given):
            layout_layers.sample_map = way  # while it is traced
            out = network.apply(params, *given, box_sets=False)
            return sum(jnp.square(x.astype(jnp.float32)).mean() for x in jax.tree.leaves(out))

        return _compiled(jax.grad(loss), params, image, camera, always)

    rows = []
    for what in (reading, gradient_of_reading, gradient_of_network):
        seconds = in_turn({name: what(way) for name, way in WAYS.items()}, given.repeats)
        ours, other = seconds["gathers"], seconds["product"]
        name = what.__name__.replace("_", " ")
        rows.append([name, f"{1000 * ours:.0f}", f"{1000 * other:.0f}", f"{ours / other:.2f}"])
    print(markdown(["", "gathers, ms", "product, ms", "ratio"], rows))


def _compiled(function: Callable, *given: Any) -> Callable[[], Any]:
    program = jax.jit(function)
    return lambda: program(*given)


if __name__ == "__main__":
    main()
