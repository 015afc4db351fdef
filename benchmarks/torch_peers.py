"""The peers of the benchmarks: TRELLIS's and DINOv2's networks in plain PyTorch for a CPU, with
upstream's parameter names.

Attention over windows is the faster of two ways at each call: a loop over the windows with their
exact lengths, or all windows padded to the longest. Sparse convolutions multiply, tap by tap, only
the pairs of voxels that exist. Sources as in ``docs/paper.md``; written for these benchmarks.
"""

from __future__ import annotations

import math

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn


class Windows:
    """A partition of T tokens into segments, for both ways."""

    def __init__(self, ids: np.ndarray):
        order = np.argsort(ids, kind="stable")
        edges = np.flatnonzero(np.r_[True, np.diff(ids[order]) != 0, True])
        lengths = np.diff(edges)
        self.lengths, tokens, longest = lengths.tolist(), len(ids), lengths.max()
        self.order = torch.as_tensor(order)
        self.inverse = torch.as_tensor(np.argsort(order))
        row = np.repeat(np.arange(len(lengths)), lengths)
        column = np.arange(tokens) - np.repeat(edges[:-1], lengths)
        index = np.full((len(lengths), longest), tokens)
        index[row, column] = order
        place = np.empty(tokens, int)
        place[order] = row * longest + column
        self.index, self.place = torch.as_tensor(index), torch.as_tensor(place)
        self.mask = torch.as_tensor(np.arange(longest) < lengths[:, None])[:, None, None]

    def loop(self, qkv: torch.Tensor) -> torch.Tensor:
        """[T, 3, N, H] -> [T, N, H]."""
        done = []
        for rows in torch.split(qkv[self.order], self.lengths):
            q, k, v = rows.permute(1, 2, 0, 3).unsqueeze(1)
            done.append(F.scaled_dot_product_attention(q, k, v)[0].transpose(0, 1))
        return torch.cat(done)[self.inverse]

    def padded(self, qkv: torch.Tensor) -> torch.Tensor:
        rows = F.pad(qkv, (0, 0, 0, 0, 0, 0, 0, 1))[self.index]
        q, k, v = rows.permute(2, 0, 3, 1, 4)
        out = F.scaled_dot_product_attention(q, k, v, attn_mask=self.mask)
        return out.permute(0, 2, 1, 3).reshape(-1, *qkv.shape[2:])[self.place]


class RMS(nn.Module):
    def __init__(self, heads: int, size: int):
        super().__init__()
        self.gamma = nn.Parameter(torch.ones(heads, size))

    def forward(self, x):
        return F.normalize(x, dim=-1) * self.gamma * x.shape[-1] ** 0.5


class SelfAttention(nn.Module):
    def __init__(self, width: int, heads: int, rms: bool):
        super().__init__()
        self.heads = heads
        self.to_qkv, self.to_out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        if rms:
            self.q_rms_norm, self.k_rms_norm = (
                RMS(heads, width // heads),
                RMS(heads, width // heads),
            )
        self.rms = rms

    def forward(self, x, windows: Windows | None = None):
        """x [T, D]."""
        qkv = self.to_qkv(x).reshape(len(x), 3, self.heads, -1)
        if windows is not None:
            return self.to_out(windows.loop(qkv).reshape(x.shape))
        q, k, v = qkv.unbind(1)
        if self.rms:
            q, k = self.q_rms_norm(q), self.k_rms_norm(k)
        q, k, v = (a.transpose(0, 1)[None] for a in (q, k, v))
        out = F.scaled_dot_product_attention(q, k, v)[0].transpose(0, 1)
        return self.to_out(out.reshape(x.shape))


class CrossAttention(nn.Module):
    def __init__(self, width: int, context: int, heads: int):
        super().__init__()
        self.heads = heads
        self.to_q, self.to_kv = nn.Linear(width, width), nn.Linear(context, 2 * width)
        self.to_out = nn.Linear(width, width)

    def forward(self, x, context):
        q = self.to_q(x).reshape(len(x), self.heads, -1).transpose(0, 1)[None]
        k, v = self.to_kv(context).reshape(len(context), 2, self.heads, -1).permute(1, 2, 0, 3)
        out = F.scaled_dot_product_attention(q, k[None], v[None])[0].transpose(0, 1)
        return self.to_out(out.reshape(x.shape))


def mlp(width: int) -> nn.Module:
    layers = nn.Sequential(
        nn.Linear(width, 4 * width), nn.GELU("tanh"), nn.Linear(4 * width, width)
    )
    return nn.ModuleDict({"mlp": layers})


class Block(nn.Module):
    """Without modulation: the SLAT trunk's."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.attn, self.mlp = SelfAttention(width, heads, False), mlp(width)

    def forward(self, x, windows):
        x = x + self.attn(F.layer_norm(x, x.shape[-1:], eps=1e-6), windows)
        return x + self.mlp["mlp"](F.layer_norm(x, x.shape[-1:], eps=1e-6))


class ModulatedBlock(nn.Module):
    def __init__(self, width: int, context: int, heads: int):
        super().__init__()
        self.norm2 = nn.LayerNorm(width, eps=1e-6)
        self.self_attn = SelfAttention(width, heads, True)
        self.cross_attn = CrossAttention(width, context, heads)
        self.mlp = mlp(width)
        self.adaLN_modulation = nn.Sequential(nn.SiLU(), nn.Linear(width, 6 * width))

    def forward(self, x, time, context):
        shift, scale, gate, shift2, scale2, gate2 = self.adaLN_modulation(time).chunk(6, -1)
        h = F.layer_norm(x, x.shape[-1:], eps=1e-6) * (1 + scale) + shift
        x = x + gate * self.self_attn(h)
        x = x + self.cross_attn(self.norm2(x), context)
        h = F.layer_norm(x, x.shape[-1:], eps=1e-6) * (1 + scale2) + shift2
        return x + gate2 * self.mlp["mlp"](h)


def positions(coords: torch.Tensor, width: int) -> torch.Tensor:
    n = width // 3 // 2
    angles = coords.float()[..., None] / 10000 ** (torch.arange(n) / n)
    out = torch.cat([angles.sin(), angles.cos()], -1).flatten(1)
    return F.pad(out, (0, width - out.shape[1]))


class Time(nn.Module):
    def __init__(self, width: int):
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(256, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, t: float):
        angles = 1000 * t * torch.exp(-math.log(10000) * torch.arange(128) / 128)
        return self.mlp(torch.cat([angles.cos(), angles.sin()]))


class StructureFlow(nn.Module):
    """x [r^3, C] of a dense grid, context [M, D']."""

    def __init__(self, side, channels, width, context, blocks, heads):
        super().__init__()
        self.t_embedder = Time(width)
        self.input_layer, self.out_layer = nn.Linear(channels, width), nn.Linear(width, channels)
        self.blocks = nn.ModuleList(ModulatedBlock(width, context, heads) for _ in range(blocks))
        grid = torch.stack(torch.meshgrid(*[torch.arange(side)] * 3, indexing="ij"), -1)
        self.register_buffer("pos_emb", positions(grid.reshape(-1, 3), width))

    def forward(self, x, t, context):
        h, time = self.input_layer(x) + self.pos_emb, self.t_embedder(t)
        for block in self.blocks:
            h = block(h, time, context)
        return self.out_layer(F.layer_norm(h, h.shape[-1:]))


class SubmanifoldConv(nn.Module):
    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.conv = nn.ParameterDict(
            {
                "weight": torch.randn(outputs, 3, 3, 3, inputs) / (27 * inputs) ** 0.5,
                "bias": torch.zeros(outputs),
            }
        )

    def forward(self, x, pairs):
        weight = self.conv["weight"].flatten(1, 3)
        out = self.conv["bias"].expand(len(x), -1).clone()
        for tap, (here, there) in enumerate(pairs):
            out = out.index_add(0, here, x[there] @ weight[:, tap].T)
        return out


class ResBlock(nn.Module):
    def __init__(self, inputs: int, outputs: int, width: int, change: int):
        super().__init__()
        self.change = change
        self.norm1 = nn.LayerNorm(inputs, eps=1e-6)
        self.conv1, self.conv2 = SubmanifoldConv(inputs, outputs), SubmanifoldConv(outputs, outputs)
        self.emb_layers = nn.Sequential(nn.SiLU(), nn.Linear(width, 2 * outputs))
        if inputs != outputs:
            self.skip_connection = nn.Linear(inputs, outputs)

    def forward(self, x, time, level, cells):
        if self.change > 0:
            count = torch.bincount(cells)
            sums = x.new_zeros(len(count), x.shape[1]).index_add(0, cells, x)
            x = sums / (count + 1)[:, None]
        elif self.change < 0:
            x = x[cells]
        scale, shift = self.emb_layers(time).chunk(2, -1)
        h = self.conv1(F.silu(self.norm1(x)), level)
        h = F.layer_norm(h, h.shape[-1:], eps=1e-6) * (1 + scale) + shift
        h = self.conv2(F.silu(h), level)
        return h + (self.skip_connection(x) if hasattr(self, "skip_connection") else x)


class LatentFlow(nn.Module):
    """x [T, C] on one object's voxels; pairs of both levels, the cell of each voxel, and the cells'
    coords."""

    def __init__(self, channels, width, context, blocks, heads, io):
        super().__init__()
        self.t_embedder = Time(width)
        self.input_layer, self.out_layer = nn.Linear(channels, io), nn.Linear(io, channels)
        self.input_blocks = nn.ModuleList(
            [ResBlock(io, io, width, 0), ResBlock(io, width, width, 1)]
        )
        self.blocks = nn.ModuleList(ModulatedBlock(width, context, heads) for _ in range(blocks))
        self.out_blocks = nn.ModuleList(
            [ResBlock(2 * width, io, width, -1), ResBlock(2 * io, io, width, 0)]
        )

    def forward(self, x, t, context, fine, coarse, cells, cell_coords):
        time = self.t_embedder(t)
        first = self.input_blocks[0](self.input_layer(x), time, fine, cells)
        h = second = self.input_blocks[1](first, time, coarse, cells)
        h = h + positions(cell_coords, h.shape[-1])
        for block in self.blocks:
            h = block(h, time, context)
        h = self.out_blocks[0](torch.cat([h, second], -1), time, fine, cells)
        h = self.out_blocks[1](torch.cat([h, first], -1), time, fine, cells)
        return self.out_layer(F.layer_norm(h, h.shape[-1:]))


def conv_pairs(neighbors: np.ndarray) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Of each tap of a plan [T, 27]: the voxels that have a neighbour there, and the neighbours."""
    pairs = []
    for column in neighbors.T:
        here = np.flatnonzero(column < len(neighbors))
        pairs.append((torch.as_tensor(here), torch.as_tensor(column[here].astype(np.int64))))
    return pairs


class SlatEncoder(nn.Module):
    """feats [T, C] with coords and the two window partitions."""

    def __init__(self, inputs, width, latent, blocks, heads):
        super().__init__()
        self.input_layer, self.out_layer = nn.Linear(inputs, width), nn.Linear(width, 2 * latent)
        self.blocks = nn.ModuleList(Block(width, heads) for _ in range(blocks))

    def forward(self, x, coords, windows):
        h = self.input_layer(x)
        h = h + positions(coords, h.shape[-1])
        for i, block in enumerate(self.blocks):
            h = block(h, windows[i % 2])
        return self.out_layer(F.layer_norm(h, h.shape[-1:]))


class ViTBlock(nn.Module):
    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width, eps=1e-6), nn.LayerNorm(width, eps=1e-6)
        self.attn = nn.ModuleDict(
            {"qkv": nn.Linear(width, 3 * width), "proj": nn.Linear(width, width)}
        )
        self.mlp = nn.ModuleDict(
            {"fc1": nn.Linear(width, 4 * width), "fc2": nn.Linear(4 * width, width)}
        )
        self.ls1 = nn.ParameterDict({"gamma": torch.ones(width)})
        self.ls2 = nn.ParameterDict({"gamma": torch.ones(width)})

    def forward(self, x):
        items, tokens, _ = x.shape
        qkv = self.attn["qkv"](self.norm1(x)).reshape(items, tokens, 3, self.heads, -1)
        out = F.scaled_dot_product_attention(*qkv.permute(2, 0, 3, 1, 4))
        x = x + self.ls1["gamma"] * self.attn["proj"](out.transpose(1, 2).reshape(x.shape))
        return x + self.ls2["gamma"] * self.mlp["fc2"](F.gelu(self.mlp["fc1"](self.norm2(x))))


class DINOv2(nn.Module):
    """image [B, 3, H, W], normalised -> tokens before the last norm."""

    def __init__(self, size=518, width=1024, blocks=24, heads=16, registers=4):
        super().__init__()
        self.cls_token = nn.Parameter(torch.randn(1, 1, width) * 0.02)
        self.mask_token = nn.Parameter(torch.zeros(1, width))
        self.register_tokens = nn.Parameter(torch.randn(1, registers, width) * 0.02)
        self.pos_embed = nn.Parameter(torch.randn(1, 1 + (size // 14) ** 2, width) * 0.02)
        self.patch_embed = nn.ModuleDict({"proj": nn.Conv2d(3, width, 14, 14)})
        self.blocks = nn.ModuleList(ViTBlock(width, heads) for _ in range(blocks))
        self.norm = nn.LayerNorm(width, eps=1e-6)

    def forward(self, image):
        x = self.patch_embed["proj"](image).flatten(2).transpose(1, 2)
        x = torch.cat([self.cls_token.expand(len(x), -1, -1), x], 1) + self.pos_embed
        x = torch.cat([x[:, :1], self.register_tokens.expand(len(x), -1, -1), x[:, 1:]], 1)
        for block in self.blocks:
            x = block(x)
        return x
