"""64^3 voxels, trained from scratch on procedural objects: between nano and the paper's size.

Command: python train.py --config configs/small.py
Hardware: one accelerator of 24 GB or more (bfloat16). On two CPU cores one step of its latent flow
    (4 objects) takes about half a minute (benchmarks/training_step.py), so do not.
Time and result: not known; it has not been trained yet.
"""

import dataclasses

from uniart_jax.config import (
    Config,
    DataConfig,
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    LatentSampleConfig,
    LossConfig,
    ModelConfig,
    StageConfig,
    StructureSampleConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)


def config() -> Config:
    flow = FlowConfig(
        model_channels=512,
        num_blocks=12,
        num_heads=8,
        cond_channels=256,
        patch_size=2,
        volume_channels=64,
        volume_resolution=8,
        prediction="data",
    )
    stage = StageConfig(
        steps=100_000,
        batch_size=16,
        learning_rate=3e-4,
        schedule="cosine",
        warmup_steps=1000,
        ema_decay=0.999,
        evaluate_every=2500,
        save_every=2500,
    )
    return Config(
        name="small",
        model=ModelConfig(
            grid=GridConfig(resolution=64, subdivisions=4, max_parts=16),
            image_encoder=ImageEncoderConfig(
                image_size=256,
                stem_stride=4,
                stem_channels=(32, 64, 128),
                width=256,
                num_blocks=4,
                num_heads=4,
                volume_blocks=4,
                volume_channels=64,
            ),
            structure_vae=StructureVAEConfig(channels=(16, 64, 256)),
            uniart_vae=UniArtVAEConfig(
                width=256, num_blocks=6, num_heads=4, visual_channels=0, linear_path=True
            ),
            structure_flow=flow,
            latent_flow=dataclasses.replace(flow, io_channels=(64,)),
            compute_dtype="bfloat16",
            scan_blocks=True,
            remat=True,
        ),
        data=DataConfig(
            records="data-cache/small",
            validation="data-cache/small-validation",
            procedural=50_000,
            views=4,
            voxel_buckets=(16384, 24576, 36864, 49152),
            mirror_latents=False,
        ),
        loss=LossConfig(
            kl=1e-4,
            articulation=10.0,
            color=5.0,
            voxels_per_object=4096,
            part_share=0.5,
            readout_share=0.9,
            noise_share=0.5,
            draws_per_image=2,
        ),
        image_encoder=stage,
        structure_vae=dataclasses.replace(stage, steps=20_000),
        uniart_vae=dataclasses.replace(stage, steps=50_000, batch_size=4),
        structure_flow=stage,
        latent_flow=dataclasses.replace(stage, batch_size=4),
        sample_structure=StructureSampleConfig(steps=12, guidance=1.0),
        sample_latent=LatentSampleConfig(steps=12, guidance=1.0),
    )
