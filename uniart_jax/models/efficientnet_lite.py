"""EfficientNet-Lite0 up to stride 16, its batch norms folded into the convolutions (Tan and Le
2019; TensorFlow TPU's ``lite``).

Names follow the published PyTorch file: ``stem``, ``blocks.<i>.expand_conv``, ``depthwise_conv``,
``project_conv``.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from flax import nnx

from uniart_jax.nn.blocks import linear
from uniart_jax.nn.depthwise import depthwise_conv, sum_of_shifts

# inputs, outputs, kernel, stride of the first block, expansion, blocks
STAGES = (
    (32, 16, 3, 1, 1, 1),
    (16, 24, 3, 2, 6, 2),
    (24, 40, 5, 2, 6, 2),
    (40, 80, 3, 2, 6, 3),
    (80, 112, 5, 1, 6, 3),
)
TAPS = (2, 4, 10)  # blocks whose outputs are the maps


class Depthwise(nnx.Module):
    """A depthwise convolution with a bias; kernel [k, k, C]. ``plain``: JAX's own derivatives."""

    def __init__(
        self, channels: int, kernel: int, stride: int, rngs: nnx.Rngs, plain: bool = False
    ):
        shape = (kernel, kernel, channels)
        self.kernel = nnx.Param(jax.random.normal(rngs.params(), shape) * (2**0.5 / kernel))
        self.bias = nnx.Param(jnp.zeros(channels))
        self.stride, self.plain = stride, plain

    def __call__(self, x: jax.Array) -> jax.Array:
        kernel = self.kernel[...].astype(x.dtype)
        convolve = sum_of_shifts if self.plain else depthwise_conv
        return convolve(x, kernel, self.stride) + self.bias[...].astype(x.dtype)


class Block(nnx.Module):
    """Inverted bottleneck: 1x1 up, depthwise, 1x1 down."""

    def __init__(self, inputs, outputs, kernel, stride, expansion, rngs: nnx.Rngs, dtype, plain):
        wide = inputs * expansion
        self.skip = stride == 1 and inputs == outputs
        self.expands = expansion > 1
        if self.expands:
            self.expand_conv = linear(inputs, wide, rngs, dtype=dtype)
        self.depthwise_conv = Depthwise(wide, kernel, stride, rngs, plain)
        self.project_conv = linear(wide, outputs, rngs, dtype=dtype)

    def __call__(self, x: jax.Array) -> jax.Array:
        y = jax.nn.relu6(self.expand_conv(x)) if self.expands else x
        y = self.project_conv(jax.nn.relu6(self.depthwise_conv(y)))
        return x + y if self.skip else y


class EfficientNetLite0(nnx.Module):
    """image [B, H, W, 3] in [-1, 1] -> maps at strides 4, 8, 16 with 24, 40, 112 channels; sides
    are multiples of 16."""

    CHANNELS = (24, 40, 112)

    def __init__(self, rngs: nnx.Rngs, dtype=jnp.float32, plain: bool = False):
        same = ((0, 1), (0, 1))  # TensorFlow's SAME for stride 2 and even sides
        self.stem = nnx.Conv(3, 32, (3, 3), strides=2, padding=same, dtype=dtype, rngs=rngs)
        blocks = []
        for inputs, outputs, kernel, stride, expansion, count in STAGES:
            for i in range(count):
                shape = (
                    (inputs, outputs, kernel, stride) if i == 0 else (outputs, outputs, kernel, 1)
                )
                blocks.append(Block(*shape, expansion, rngs, dtype, plain))
        self.blocks = nnx.List(blocks)

    def __call__(self, image: jax.Array) -> tuple[jax.Array, ...]:
        x, maps = jax.nn.relu6(self.stem(image)), []
        for i, block in enumerate(self.blocks):
            x = block(x)
            if i in TAPS:
                maps.append(x)
        return tuple(maps)
