"""The sum of shifted products against XLA's own depthwise convolution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.nn.depthwise import depthwise_conv


def reference(x, kernel, stride):
    return jax.lax.conv_general_dilated(
        x, kernel[:, :, None], (stride, stride), "SAME",
        dimension_numbers=("NHWC", "HWIO", "NHWC"), feature_group_count=x.shape[-1],
    )  # fmt: skip


@pytest.mark.parametrize(("size", "stride", "side"), [(3, 1, 7), (5, 1, 8), (3, 2, 8), (5, 2, 10)])
def test_values_and_gradients(size, stride, side):
    keys = jax.random.split(jax.random.key(0), 3)
    x = jax.random.normal(keys[0], (2, side, side + 2 * stride, 5))
    kernel = jax.random.normal(keys[1], (size, size, 5))
    weights = jax.random.normal(keys[2], reference(x, kernel, stride).shape)

    @jax.jit
    def both(x, kernel):
        def run(f):
            return jax.value_and_grad(lambda *a: (f(*a, stride) * weights).sum(), (0, 1))(x, kernel)

        return depthwise_conv(x, kernel, stride), run(depthwise_conv), run(reference)

    values, (_, ours), (_, theirs) = both(x, kernel)
    np.testing.assert_allclose(values, reference(x, kernel, stride), atol=1e-4)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)
    assert jnp.isfinite(values).all()
