"""Makes efficientnet_lite0.npz: what PyTorch says of the published weights. Needs torch; run once.

    python tests/models/make_efficientnet_lite0.py PATH/TO/efficientnet-lite0-57934424.pth

Batch norms are applied as they are stored, not folded, so that folding is tested too.
"""

import pathlib
import sys

import numpy as np
import torch
import torch.nn.functional as F

PLAN = ((16, 3, 1, 1, 1), (24, 3, 2, 6, 2), (40, 5, 2, 6, 2), (80, 3, 2, 6, 3), (112, 5, 1, 6, 3))
SAMPLES = 400


def image() -> np.ndarray:
    """[2, 64, 96, 3] float32 in [-1, 1], smooth enough to look like something."""
    y, x = np.mgrid[:64, :96] / 64
    waves = [np.sin(7 * x + 3 * k) * np.cos(5 * y - k) for k in range(6)]
    return np.stack(waves, -1).reshape(64, 96, 2, 3).transpose(2, 0, 1, 3).astype(np.float32)


def main(path: str) -> None:
    z = torch.load(path, weights_only=True)

    def conv(x, name, norm, stride=1, groups=1):
        w = z[f"{name}.weight"]
        k = w.shape[-1]
        total = max(k - stride, 0) if stride == 2 else k - 1
        before = total // 2
        x = F.pad(x, (before, total - before, before, total - before))
        x = F.conv2d(x, w, stride=stride, groups=groups)
        names = ("running_mean", "running_var", "weight", "bias")
        return F.batch_norm(x, *(z[f"{norm}.{n}"] for n in names), training=False, eps=1e-3)

    x = torch.from_numpy(image()).permute(0, 3, 1, 2)
    x = F.relu6(conv(x, "_conv_stem", "_bn0", 2))
    maps, number = [], 0
    for stage, (_, _, stride, expand, count) in enumerate(PLAN):
        for i in range(count):
            n, y = f"_blocks.{number}.", x
            if expand > 1:
                y = F.relu6(conv(y, n + "_expand_conv", n + "_bn0"))
            y = conv(y, n + "_depthwise_conv", n + "_bn1", stride if i == 0 else 1, y.shape[1])
            y = conv(F.relu6(y), n + "_project_conv", n + "_bn2")
            x = x + y if x.shape == y.shape else y
            number += 1
        if stage in (1, 2, 4):
            maps.append(x.permute(0, 2, 3, 1).numpy())
    rng, out = np.random.default_rng(0), {}
    for i, values in enumerate(maps):
        place = rng.choice(values.size, SAMPLES, replace=False)
        out |= {f"shape{i}": values.shape, f"place{i}": place, f"value{i}": values.ravel()[place]}
        out[f"largest{i}"] = np.abs(values).max()
    np.savez_compressed(pathlib.Path(__file__).with_name("efficientnet_lite0.npz"), **out)


if __name__ == "__main__":
    main(sys.argv[1])
