"""Training: one file a stage, and the run through them.

image_encoder   images -> coarse occupancy, boxes, joints            (then frozen)
structure_vae   occupancy <-> dense latent
uniart_vae      voxels with everything on them <-> latent per voxel
(encode)        all records through both VAEs, once
structure_flow  noise -> structure latent, given the image
latent_flow     noise on the active voxels -> UniArt latent, given the image
layout          images -> the object's parts as a set (where the config has ``layout.queries``)
"""

from uniart_jax.stages.stage import Stage
from uniart_jax.stages.table import STAGES
from uniart_jax.stages.trainer import Trainer, run

__all__ = ["STAGES", "Stage", "Trainer", "run"]
