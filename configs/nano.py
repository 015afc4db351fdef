"""A model small enough for a laptop: procedural objects at 32^3 voxels with 4^3 sub-cells.

Command: python train.py --config configs/nano.py
Hardware and time: two CPU cores, about six hours with the making of records; or one
    accelerator. The shipped weights were made in several steps, each of which went on from the
    weights before (--init), the last of them on a GPU (tools/train_pool.py); this config has the
    last networks and the steps of the first three trainings together, and has not been run in
    one piece. A refiner that is trained so little, on layouts that are not found, may not help.
Result: layouts of 128 held-out objects, parts right .80 [.74, .85], moving parts found .92,
    count .64 (uniart evaluate layout --checkpoint nano).
Each training: docs/training_history.md; figures: docs/model_card.md.
"""

import dataclasses

from uniart_jax.config import (
    Config,
    DataConfig,
    FlowConfig,
    GridConfig,
    ImageEncoderConfig,
    LatentSampleConfig,
    LayoutConfig,
    LossConfig,
    MaskConfig,
    ModelConfig,
    StageConfig,
    StructureSampleConfig,
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
            layout=LayoutConfig(
                queries=16,
                image_size=256,
                repeats=2,
                legs=8,
                panels=24,
                boards=12,
                revolutions=True,
            ),
            mask=MaskConfig(channels=64),
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
                layout_channels=64,
            ),
            structure_flow=dataclasses.replace(
                flow,
                num_blocks=5,
                patch_size=2,
                layout_channels=32,
                refine_channels=8,
                pixel_channels=8,
            ),
            latent_flow=dataclasses.replace(
                flow,
                patch_size=4,
                stem="patch",
                voxel_channels=32,
                volume_channels=64 + 3,
                pixel_channels=16,
                layout_channels=32,
            ),
        ),
        data=DataConfig(
            records="data-cache/nano",
            validation="data-cache/nano-validation",
            procedural=22_000,
            views=4,
            validation_count=70,
            voxel_buckets=(5120, 8192, 12288),
            voxel_crop=2048,
            mirror_latents=False,
            image_warp=0.03,
            layout_errors=1.0,
            photographs=0.5,
        ),
        loss=LossConfig(
            kl=1e-4,
            articulation=10.0,
            color=5.0,
            voxels_per_object=1024,
            part_share=0.5,
            readout_share=0.9,
            noise_share=0.8,
            draws_per_image=2,
            refined=0.5,
            decoded_structure=1.0,
        ),
        image_encoder=dataclasses.replace(stage, steps=13_500, batch_size=32, evaluate_every=500),
        structure_vae=dataclasses.replace(stage, steps=300, learning_rate=2e-3, evaluate_every=150),
        uniart_vae=dataclasses.replace(
            stage, steps=2000, batch_size=4, learning_rate=2e-3, evaluate_every=500
        ),
        layout=dataclasses.replace(
            stage,
            steps=2700,
            batch_size=32,
            learning_rate=8e-4,
            schedule="linear",
            muon=2.0,
            slow=("backbone",),
            betas=(0.9, 0.98),
            weight_decay=0.02,
            warmup_steps=150,
            evaluate_every=400,
            save_every=200,
        ),
        mask=dataclasses.replace(
            stage,
            steps=1650,
            schedule="linear",
            slow=("backbone",),
            freeze=("backbone.stem", *(f"backbone.blocks.{i}" for i in range(5))),
            weight_decay=0.02,
            evaluate_every=250,
        ),
        structure_flow=dataclasses.replace(stage, steps=3250, evaluate_every=250),
        latent_flow=dataclasses.replace(stage, steps=30_000, batch_size=4),
        sample_structure=StructureSampleConfig(
            steps=1, guidance=1.0, rescale_t=3.0, threshold=-0.2, mirrored=True
        ),
        sample_latent=LatentSampleConfig(
            steps=1,
            guidance=1.0,
            rescale_t=3.0,
            sdf_offset=0.3,
            sdf_blur=0.5,
            sdf_blur_along=2.0,
            mirrored=True,
        ),
    )
