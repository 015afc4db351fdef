"""A model small enough to train on a laptop: procedural furniture and appliances at 32^3 voxels with 4^3 sub-cells.

Command: python train.py --config configs/nano.py
Hardware: two CPU cores, hours; or one accelerator. Records (10,560 objects): about 30 minutes on two cores, .8 GB.
Expected result: not known yet; no model of this config has been trained through. What it rests on, on 70 validation objects (the flows: 48), one
core a stage, one seed each, the other core busy:
- image encoder: 50 images a second, 6,000 steps: IoU .482 at 32^3 (.56 on training images: more objects would help), parts found .12. Before, at 64^2
  pixels, without camera and lifting, 3,000 steps on 7,000 objects: .426 (.472), .02;
- structure VAE: IoU .974 after 500 steps (18 minutes; trained on the first 4,200 objects only);
- UniArt VAE: 3,500 steps, 60 minutes (on the first 7,000 objects only): parts found .99, right .90, type .99, axis .85 degrees, pivot .015, inside IoU .90;
- structure flow: 19 draws a second; IoU .50 from step 400 to 1,200: the image encoder limits it. Sampling steps and guidance 1: 1 step .518, 2 .505, 4 .501, 8 .499;
- latent flow: 7.5 objects a second. After 1,000, 2,000 and 3,000 of its 12,000 steps parts found .47, .64, .72, right .06, .16, .23 given the true
  structure (the weights of `training/readout.py` changed at step 1,748). Before, with the plain square error and
  shown x_t itself, .14 and 0 after 2,000. Validation after 300 steps, unexplained variance of boxes: plain input .65, best linear guess .56.
  Muon instead of AdamW at the same rate: loss 1.17 instead of .94 after 200 steps.
"""

import dataclasses

from uniart_jax.config import (
    Config,
    DataConfig,
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    LossConfig,
    ModelConfig,
    SampleConfig,
    StageConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)


def config() -> Config:
    flow = FlowConfig(
        model_channels=192,
        num_blocks=4,
        num_heads=4,
        cond_channels=128,
        volume_channels=64,
        volume_resolution=8,
        prediction="data",
    )
    stage = StageConfig(
        steps=10_000,
        batch_size=16,
        learning_rate=1e-3,
        schedule="cosine",
        warmup_steps=100,
        ema_decay=0.998,
        log_every=50,
        evaluate_every=1000,
        save_every=500,
    )
    return Config(
        name="nano",
        model=ModelConfig(
            grid=GridConfig(resolution=32, subdivisions=4, max_parts=16),
            image_encoder=ImageEncoderConfig(
                image_size=128,
                stem_stride=4,
                stem_channels=(24, 48, 96),
                width=128,
                num_blocks=0,
                num_heads=4,
                volume_tokens=4,
                volume_blocks=1,
                volume_channels=64,
            ),
            structure_vae=StructureVAEConfig(
                patch_size=2, channels=(16, 48), num_res_blocks=1, num_res_blocks_middle=1
            ),
            uniart_vae=UniArtVAEConfig(
                width=96,
                num_blocks=2,
                num_heads=4,
                latent_channels=16,
                attention="serial",
                window=128,
                visual_channels=0,
                geometry_channels=64,
                articulation_channels=64,
                part_segment=256,
                linear_path=True,
            ),
            structure_flow=dataclasses.replace(flow, num_blocks=5, patch_size=2),
            latent_flow=dataclasses.replace(
                flow, patch_size=4, stem="patch", voxel_channels=32, volume_channels=64 + 3
            ),
        ),
        data=DataConfig(
            records="data-cache/nano",
            validation="data-cache/nano-validation",
            procedural=5_600,
            views=4,
            validation_count=70,
            voxel_buckets=(5120, 8192, 12288),
            voxel_crop=2048,
            mirror_latents=False,
        ),
        loss=LossConfig(
            kl=1e-4,
            articulation=10.0,
            color=5.0,
            voxels_per_object=1024,
            part_share=0.5,
            readout_share=0.9,
            noise_share=0.5,
            draws_per_image=2,
        ),
        image_encoder=dataclasses.replace(stage, steps=3500, batch_size=32, evaluate_every=500),
        structure_vae=dataclasses.replace(stage, steps=300, learning_rate=2e-3, evaluate_every=150),
        uniart_vae=dataclasses.replace(
            stage, steps=2000, batch_size=4, learning_rate=2e-3, evaluate_every=500
        ),
        structure_flow=dataclasses.replace(stage, steps=500, evaluate_every=250),
        latent_flow=dataclasses.replace(stage, steps=8400, batch_size=4),
        sample_structure=SampleConfig(steps=4, guidance=1.0, rescale_t=3.0),
        sample_latent=SampleConfig(steps=4, guidance=1.0, rescale_t=3.0),
    )
