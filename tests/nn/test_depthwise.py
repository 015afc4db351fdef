"""The sum of shifted products against XLA's own depthwise convolution."""

import jax
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
    rng = np.random.default_rng(0)
    x = rng.normal(size=(2, side, side + 2 * stride, 5)).astype(np.float32)
    kernel = rng.normal(size=(size, size, 5)).astype(np.float32)
    shape = jax.eval_shape(lambda x, kernel: reference(x, kernel, stride), x, kernel).shape
    weights = rng.normal(size=shape).astype(np.float32)

    @jax.jit
    def both(x, kernel):
        def run(f):
            def loss(*a):
                out = f(*a, stride)
                return (out * weights).sum(), out

            return jax.grad(loss, (0, 1), has_aux=True)(x, kernel)

        return run(depthwise_conv), run(reference)

    (ours, values), (theirs, expected) = both(x, kernel)
    np.testing.assert_allclose(values, expected, atol=1e-4)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)
    assert np.isfinite(values).all()
