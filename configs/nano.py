"""A model small enough to train on a laptop: procedural furniture and appliances at 32^3 voxels with 4^3 sub-cells.

Command: python train.py --config configs/nano.py
Hardware: two CPU cores, hours; or one accelerator. Records (14,000 objects): about 40 minutes on two cores, 1 GB.
Expected result: not known yet; no model of this config has been trained through. What it rests on, measured on 70 validation objects, one core a stage:
- image encoder: 104 images a second; 96,000 images of 7,000 objects (15 minutes) give IoU .426 at 32^3 (.472 on training images). A ViT on
  patches: .18, on training images, after 24,000 images of 4,200 objects. More objects help most: at 16^3 .51 with 2,100 of them, .55 with 4,200, same network;
- structure VAE: IoU .974 after 500 steps (18 minutes on a shared core);
- UniArt VAE, boxes still fitted as a mixture, 2,500 steps on 4,200 objects, 42 minutes: parts found .97, right .86, colour error .034; with two boxes by
  name the losses on boxes and joints are 1.5 and 2 times smaller at step 600. After clustering (21 objects): recall .95, parts right .86, count .67;
- structure flow, 21 a second: IoU .43 with 10 steps, .47 with 1 (the conditional mean), no better from 1,000 to 3,000 steps: the image
  encoder limits it;
- latent flow, 8 a second: after 16,000 objects (33 minutes) and without part_share .14 of the parts found given the true structure: far from enough.
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
            procedural=14_000,
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
        image_encoder=dataclasses.replace(stage, steps=6000, batch_size=32, evaluate_every=500),
        structure_vae=dataclasses.replace(stage, steps=500, learning_rate=2e-3, evaluate_every=250),
        uniart_vae=dataclasses.replace(
            stage, steps=3500, batch_size=4, learning_rate=2e-3, evaluate_every=500
        ),
        structure_flow=dataclasses.replace(stage, steps=1200, evaluate_every=400),
        latent_flow=dataclasses.replace(stage, steps=12_000, batch_size=8),
        sample_structure=SampleConfig(steps=10, guidance=1.0, rescale_t=3.0),
        sample_latent=SampleConfig(steps=10, guidance=0.0, rescale_t=3.0),
    )
