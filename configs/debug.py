"""Every stage, to see that they run; the result is noise.

Command: python train.py --config configs/debug.py
Hardware and time: two CPU cores, 52 s, a third of it compiling; once compiled, 39 s (of another
day, on the same kind of machine, 114 and 73).
"""

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
    stage = StageConfig(
        steps=4,
        batch_size=2,
        learning_rate=1e-3,
        warmup_steps=1,
        log_every=2,
        evaluate_every=4,
        save_every=4,
    )
    flow = FlowConfig(
        model_channels=48,
        num_blocks=1,
        num_heads=2,
        cond_channels=48,
        patch_size=2,
        volume_channels=8,
        volume_resolution=8,
        prediction="data",
    )
    return Config(
        name="debug",
        quick_compile=True,
        model=ModelConfig(
            grid=GridConfig(resolution=32, subdivisions=2, max_parts=16),
            image_encoder=ImageEncoderConfig(
                image_size=64,
                stem_stride=4,
                stem_channels=(8, 16),
                width=48,
                num_blocks=1,
                num_heads=2,
                volume_blocks=1,
                volume_channels=8,
            ),
            structure_vae=StructureVAEConfig(
                patch_size=2, channels=(8, 16), num_res_blocks=1, num_res_blocks_middle=1
            ),
            uniart_vae=UniArtVAEConfig(
                width=32,
                num_blocks=2,
                num_heads=2,
                latent_channels=4,
                attention="serial",
                window=64,
                visual_channels=0,
                geometry_channels=16,
                articulation_channels=16,
                part_segment=64,
            ),
            structure_flow=flow,
            latent_flow=FlowConfig(
                **{**flow.__dict__, "stem": "patch", "patch_size": 8, "pixel_channels": 8}
            ),
        ),
        data=DataConfig(
            records="data-cache/debug",
            validation="data-cache/debug-validation",
            procedural=14,
            validation_count=7,
            voxel_buckets=(12288, 18432),
        ),
        loss=LossConfig(voxels_per_object=128),
        image_encoder=stage,
        structure_vae=stage,
        uniart_vae=stage,
        structure_flow=stage,
        latent_flow=stage,
        sample_structure=StructureSampleConfig(steps=2),
        sample_latent=LatentSampleConfig(steps=2),
    )
