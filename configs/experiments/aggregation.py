"""Table 3: how geometry and articulation meet before the UniArt VAE's encoder.

Command: uniart experiment aggregation                          nano size
         uniart experiment aggregation --size paper             needs what configs/paper.py needs
What varies: model.uniart_vae.aggregation: part-wise UniArt attention, self-attention over windows, residual (articulation
      added to geometry), pooling over the part, and concat (the "vanilla aggregation" of Table 2, whose other row this is). With it, what belongs to it:
      the number of parameters (in the table) and the width of the encoder's input; self-attention looks at windows, uniart and pooling at parts.
      At nano size what the networks share by name and shape begins with equal values, and equal seeds see equal batches; at paper size all begin with TRELLIS's
      weights (experiments/fronts.py).
Expected (the paper, generated objects, RS / AS PSNR and RS / AS Chamfer distance): uniart 28.52 / 23.77, .0095 / .0376; self_attention 25.33 / 22.04,
      .0148 / .0457; residual 20.92 / 18.62, .0170 / .0499; pooling 20.37 / 17.23, .0176 / .0493; concat (Table 2) 23.75 / 21.37, .0149 / .0462.
Nano: the UniArt VAE of configs/nano.py, but with whole parts (part_segment 0), for 500 steps of 4 objects with 1,024 voxels drawn of each, judged on its reconstruction of held-out objects:
      the first station at which an aggregation can matter, and not the paper's, which is image to object.
What is not tested: the paper's attention. Its query holds a part feature of each voxel (PartField's). Without one V_art is the code of the part alone, so all
      voxels of a part ask alike and get the same answer: 'uniart' is pooling over the part with learned weights a head, 'pooling' the plain mean. So
      the table holds weighted pooling against plain, and both against none. Procedural records cannot have part features (PartField needs CUDA and its
      weights are non-commercial), and configs/paper.py has none either: at paper size set part_feature_channels = 448 there, after uniart features
      RECORDS --part-features. In the twin, linear_path, a linear layer past the trunk, lets each voxel's own attributes through whatever the aggregation,
      and while training a part is what of it lies in the 1,024 voxels drawn of an object.
Hardware and time, nano: one CPU core, five arms, three seeds; 500 steps at .46 s on an idle one and 28 objects
      at 6 s: two hours beside other work.
Hardware and time, paper: four trainings of configs/paper.py (8 x A100 each) beside that of main; unknown, never run by us.
"""

import dataclasses
from pathlib import Path
from typing import get_args

from uniart_jax.cli import load_config
from uniart_jax.config import Aggregation, Config
from uniart_jax.experiments.design import (
    OBJECT_COLUMNS,
    PAPER_STAGES,
    Arm,
    Experiment,
    Objects,
    Records,
    trained_on,
    with_aggregation,
)

CONFIGS = Path(__file__).parent.parent
RECORDS = Records("data-cache/experiments-seen", count=2000)


def nano() -> Config:
    config = load_config(CONFIGS / "nano.py")
    stage = dataclasses.replace(
        config.uniart_vae, steps=500, warmup_steps=50, ema_decay=0.99, save_every=100
    )
    # no layout for the decoder: what the latents hold is asked
    vae = dataclasses.replace(config.model.uniart_vae, part_segment=0, layout_channels=0)
    model = dataclasses.replace(config.model, uniart_vae=vae)
    config = dataclasses.replace(config, model=model, uniart_vae=stage)
    return trained_on(config, RECORDS, voxel_crop=1024)


def experiment(size: str) -> Experiment:
    if size == "nano":
        arms = {
            kind: Arm(with_aggregation(nano(), kind), ("uniart_vae",), "vae")
            for kind in get_args(Aggregation)
        }
        return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=3, count=28, records=(RECORDS,))
    config = load_config(CONFIGS / "paper.py")
    tests = Objects(records=config.data.validation, split="test")
    arms = {"uniart": Arm(config, (), "object", tests, of="main/uniart")}
    for kind in get_args(Aggregation)[1:]:
        arms[kind] = Arm(with_aggregation(config, kind), PAPER_STAGES, "object", tests)
    return Experiment(arms, "uniart", OBJECT_COLUMNS, seeds=1, count=200)
