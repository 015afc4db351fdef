"""All stages, in the order in which they are trained."""

from __future__ import annotations

from uniart_jax.stages.image_encoder import ImageEncoderStage
from uniart_jax.stages.latent_flow import LatentFlowStage
from uniart_jax.stages.layout import LayoutStage
from uniart_jax.stages.mask import MaskStage
from uniart_jax.stages.stage import Stage
from uniart_jax.stages.structure_flow import StructureFlowStage
from uniart_jax.stages.structure_vae import StructureVAEStage
from uniart_jax.stages.uniart_vae import UniArtVAEStage

# Append at the end: a stage's place is part of its seed. A stage of one's own may take a place:
# ``STAGES["structure_vae"] = Focal()`` (docs/tutorial.md, "A loss of your own").
STAGES: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        ImageEncoderStage(),
        StructureVAEStage(),
        UniArtVAEStage(),
        StructureFlowStage(),
        LatentFlowStage(),
        LayoutStage(),
        MaskStage(),
    )
}
