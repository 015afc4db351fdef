"""The paper's model: every network at TRELLIS's size, started from TRELLIS's weights, the image encoder DINOv2, frozen.

Commands: uniart convert trellis CKPTS --out weights/trellis                      CKPTS: the ckpts folder of TRELLIS-image-large
          uniart convert dinov2 dinov2_vitl14_reg4_pretrain.pth --out weights/trellis
          python train.py --config configs/paper.py --data.records RECORDS
Hardware: 8 accelerators of 80 GB (the paper: 8 x A100, 800,000 iterations, batch 64). Not run at this size by us; the time is unknown.
It waits for records with multi-view features (``model.uniart_vae.visual_channels``, ``models.multiview``): without them training says so and stops.
Expected result: the paper's Table 1. Without the start from TRELLIS its own ablation falls from PSNR 28.5 to 13.2.

Parameters, of which TRELLIS's form has: structure VAE 59.3 + 73.7 M, structure flow 555.5 M, latent flow 600.4 M, SLAT encoder 85.8 M, DINOv2 304.4 M.
"""

from uniart_jax.config import (
    Config,
    DataConfig,
    ImageEncoderConfig,
    LatentSampleConfig,
    ModelConfig,
    StageConfig,
    StructureSampleConfig,
)


def config() -> Config:
    stage = StageConfig(steps=800_000, batch_size=64, learning_rate=1e-4, ema_decay=0.9995)
    sampling = dict(steps=25, guidance=5.0, guidance_interval=(0.5, 1.0), rescale_t=3.0)
    return Config(
        name="paper",
        init="weights/trellis",
        model=ModelConfig(
            image_encoder=ImageEncoderConfig(
                architecture="dinov2", image_size=518, width=1024, num_blocks=24, num_heads=16
            ),
            compute_dtype="bfloat16",
            scan_blocks=True,
            remat=True,
        ),
        data=DataConfig(records="data-cache/paper"),
        image_encoder=stage,
        structure_vae=stage,
        uniart_vae=stage,
        structure_flow=stage,
        latent_flow=stage,
        sample_structure=StructureSampleConfig(**sampling),
        sample_latent=LatentSampleConfig(**sampling),
    )
