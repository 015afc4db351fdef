"""``configs/debug.py`` made smaller still: what the tests of whole stages train."""

import dataclasses
from pathlib import Path

from uniart_jax.cli import load_config
from uniart_jax.config import (
    NETWORKS,
    Config,
    LatentSampleConfig,
    LossConfig,
    StructureSampleConfig,
)

DEBUG = Path(__file__).parents[2] / "configs/debug.py"


def toy(folder: Path) -> Config:
    """``configs/debug.py`` on a coarser grid, with what only nano sets: no mirrored latents, flows
    that see layouts, losses per part, on readouts, on pure noise."""
    debug = load_config(DEBUG)
    model, smaller = debug.model, dataclasses.replace
    encoder = smaller(
        model.image_encoder,
        image_size=32,
        num_blocks=0,
        volume_tokens=2,
        volume_resolution=4,
        target_resolution=8,
        sketch_width=8,
    )
    stage = smaller(debug.latent_flow, steps=2, log_every=1, evaluate_every=2, save_every=2)
    return smaller(
        debug,
        model=smaller(
            model,
            grid=smaller(model.grid, resolution=16),
            image_encoder=encoder,
            structure_vae=smaller(
                model.structure_vae, patch_size=4, channels=(8,), num_res_blocks_middle=0
            ),
            uniart_vae=smaller(model.uniart_vae, num_blocks=1),
            structure_flow=smaller(model.structure_flow, volume_resolution=4, layout_channels=4),
            latent_flow=smaller(
                model.latent_flow, patch_size=4, volume_resolution=4, layout_channels=4
            ),
        ),
        data=smaller(
            debug.data,
            records=str(folder / "records"),
            validation=str(folder / "validation"),
            procedural=3,
            validation_count=1,
            voxel_buckets=(4096,),
            mirror_latents=False,
            image_warp=0.03,
            layout_errors=0.5,
        ),
        loss=LossConfig(voxels_per_object=64, part_share=0.5, readout_share=0.5, noise_share=0.5),
        **dict.fromkeys(NETWORKS, stage),
        sample_structure=StructureSampleConfig(steps=1),
        sample_latent=LatentSampleConfig(steps=1),
    )
