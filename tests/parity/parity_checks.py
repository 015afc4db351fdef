"""One check a kind of fixture; the weights go through the converter that users go through.

Tolerances were fixed by the fixtures' makers before anything of ours ran: rtol 1e-4, atol 1e-5,
5e-5 for the flows; gradients rtol 1e-4 and atol 1e-4 of the largest entry.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from parity_cases import last
from parity_ops import check_ops

from uniart_jax.config import ModelConfig, UniArtVAEConfig
from uniart_jax.models.dinov2 import IMAGE_MEAN, IMAGE_STD
from uniart_jax.models.gaussian_decoder import activated, gaussian_parameters
from uniart_jax.models.multiview import add_views, project
from uniart_jax.models.network import build
from uniart_jax.nn.grids import flow_plan
from uniart_jax.nn.voxel_plans import voxel_plans
from uniart_jax.voxels.typed_batches import VoxelBatch
from uniart_jax.weights.compose import compose
from uniart_jax.weights.dinov2 import convert_dinov2
from uniart_jax.weights.mapping import flatten
from uniart_jax.weights.trellis import convert_trellis, slat_encoder

CLOSE = dict(rtol=1e-4, atol=1e-5)
CLOSE_FLOW = dict(rtol=1e-4, atol=5e-5)
GRADIENT = 1e-4
SIGMA = 1e-5  # TRELLIS's sigma_min
KL_WEIGHT = 0.01  # of the loss in grads_slat_encoder: mean(z^2) + .01 KL


def check_structure_encoder(case):
    model, networks = compose([convert_trellis("SparseStructureEncoder", case.config, case.state)])
    network, filled = build("structure_vae", model), networks["structure_vae"]
    assert filled.new == ("decoder",)
    encode = jax.jit(lambda params, x: network.apply(params, x, method="encode"))
    mean, logvar = encode(filled.params, last(case.inputs["x"])[..., 0])
    np.testing.assert_allclose(mean, last(case.outputs["mean"]), **CLOSE)
    np.testing.assert_allclose(logvar, last(case.outputs["logvar"]), **CLOSE)


def check_structure_decoder(case):
    model, networks = compose([convert_trellis("SparseStructureDecoder", case.config, case.state)])
    network, filled = build("structure_vae", model), networks["structure_vae"]
    assert filled.new == ("encoder",)
    decode = jax.jit(lambda params, z: network.apply(params, z, method="decode"))
    logits = decode(filled.params, last(case.inputs["z"]))
    np.testing.assert_allclose(logits, last(case.outputs["logits"])[..., 0], **CLOSE)


def check_structure_flow(case):
    model, networks = compose(
        [convert_trellis("SparseStructureFlowModel", case.config, case.state)]
    )
    network, params = build("structure_flow", model), networks["structure_flow"].params
    x, t = last(case.inputs["x"]), case.inputs["t"] / 1000
    v = jax.jit(network.apply)(params, x, t, case.inputs["cond"])
    np.testing.assert_allclose(v, last(case.outputs["v"]), **CLOSE_FLOW)


def with_plans(batch, model):
    """A ``VoxelBatch`` of arrays by name, with the plans of what they hold."""
    voxels, part = (batch["coords"], batch["counts"]), batch.get("voxel_part")
    plans = voxel_plans(*voxels, model.uniart_vae, model.grid, voxel_part=part)
    return VoxelBatch(**batch, plans=plans)


def check_slat_encoder(case):
    piece = convert_trellis("SLatEncoder", case.config, case.state)
    out = run_slat_encoder(piece, case)
    mean, logvar = np.split(out, 2, -1)
    np.testing.assert_allclose(mean, case.outputs["mean"], **CLOSE)
    np.testing.assert_allclose(logvar, case.outputs["logvar"], **CLOSE)
    check_widened_encoder(piece, case, out)


def run_slat_encoder(piece, case):
    batch, feats, rows = case.sparse()
    batch = with_plans(batch, piece.model)
    run = jax.jit(slat_encoder(piece.model).apply)
    out = run(piece.params, feats, batch.coords, batch.plans, batch.counts)
    return np.asarray(out)[rows]


def check_widened_encoder(piece, case, expected):
    """The UniArt VAE filled from the same weights gives TRELLIS's latents, whatever geometry and
    joints the voxels have besides."""
    narrow = dataclasses.replace(
        ModelConfig(), uniart_vae=UniArtVAEConfig(geometry_channels=8, articulation_channels=8)
    )
    model, networks = compose([piece], base=narrow)
    assert set(networks["uniart_vae"].new) == {
        "front",
        "decoder",
        "geometry_head",
        "segmentation_head",
        "articulation_head",
    }
    batch, feats, rows = case.sparse()
    rng = np.random.default_rng(0)
    shape, cells, parts = feats.shape[:2], model.grid.subdivisions**3, 3
    numbers = {
        "sdf": (*shape, cells), "color": (*shape, cells, 3),
        "boxes": (shape[0], parts, 6), "codes": (shape[0], parts, 9),
    }  # fmt: skip
    ids = {"owner": (*shape, cells), "voxel_part": shape, "parents": (shape[0], parts)}
    batch |= {k: rng.normal(size=s).astype(np.float32) for k, s in numbers.items()}
    batch |= {k: rng.integers(0, parts, s).astype(np.int32) for k, s in ids.items()}
    batch = with_plans({**batch, "visual": feats}, model)
    network = build("uniart_vae", model)
    encode = jax.jit(lambda params, batch: network.apply(params, batch, method="encode"))
    out = encode(networks["uniart_vae"].params, batch)
    out = np.concatenate([out["mean"], out["logvar"]], -1)
    np.testing.assert_allclose(out[rows], expected, **CLOSE)


def check_gaussian_decoder(case):
    piece = convert_trellis("SLatGaussianDecoder", case.config, case.state)
    model, networks = compose([piece])
    assert "encoder" in networks["uniart_vae"].new
    batch, feats, rows = case.sparse()
    batch = with_plans(batch, model)
    run = jax.jit(build("gaussian_decoder", model).apply)
    raw = np.asarray(run(networks["gaussian_decoder"].params, feats, batch))
    np.testing.assert_allclose(raw[rows], case.outputs["raw"], **CLOSE)

    @jax.jit
    def parameters(raw, coords):
        stored = gaussian_parameters(raw, coords, model.gaussians, model.grid.resolution)
        return stored, activated(stored, model.gaussians)

    for i, count in enumerate(batch.counts):
        stored, drawn = parameters(raw[i, :count], batch.coords[i, :count])
        pairs = [(f"{i}_{name}", value) for name, value in stored.items()]
        pairs += [(f"{i}_get_{name}", drawn[name]) for name in ("scaling", "opacity", "rotation")]
        for key, value in pairs:
            np.testing.assert_allclose(value, case.outputs[key], **CLOSE, err_msg=key)


def check_latent_flow(case):
    model, networks = compose([convert_trellis("SLatFlowModel", case.config, case.state)])
    batch, feats, rows = case.sparse()
    plan = flow_plan(batch["coords"], batch["counts"], model.latent_flow, model.grid)
    v = jax.jit(build("latent_flow", model).apply)(
        networks["latent_flow"].params,
        feats,
        case.inputs["t"] / 1000,
        case.inputs["cond"],
        **batch,
        plan=plan,
    )
    np.testing.assert_allclose(np.asarray(v)[rows], case.outputs["v"], **CLOSE_FLOW)
    for row, count in zip(np.asarray(v), batch["counts"], strict=True):
        assert not row[count:].any()


def check_dinov2(case):
    encoder, params = convert_dinov2(case.state, num_heads=case.config["num_heads"])
    network = build("image_encoder", ModelConfig(image_encoder=encoder))
    image = last(case.inputs["image"])
    x = jax.jit(lambda p, image: network.apply(p, image, method="features"))(params, image)
    np.testing.assert_allclose(x, case.outputs["x_prenorm"], **CLOSE)
    tokens = jax.jit(network.apply)(params, image * np.array(IMAGE_STD) + np.array(IMAGE_MEAN))
    np.testing.assert_allclose(tokens["tokens"], case.outputs["trellis_cond"], **CLOSE)
    final_norm = jax.jit(lambda p, x: network.apply(p, x, method="final_norm"))
    normed = np.asarray(final_norm(params, x))
    patches = normed[:, 1 + encoder.registers :]
    np.testing.assert_allclose(patches, case.outputs["x_norm_patchtokens"], **CLOSE)
    if "x_norm_clstoken" in case.outputs:
        np.testing.assert_allclose(normed[:, 0], case.outputs["x_norm_clstoken"], **CLOSE)


def check_features(case):
    cameras, positions = (
        (case.inputs["extrinsics"], case.inputs["intrinsics"]),
        case.inputs["positions"],
    )
    side = case.config["patches"]
    patches = case.inputs["patchtokens"].reshape(len(cameras[0]), side, side, -1)
    none, projected = np.zeros((len(positions), patches.shape[-1]), np.float32), jax.jit(project)
    for m, (extrinsic, intrinsic) in enumerate(zip(*cameras, strict=True)):
        uv = projected(positions, extrinsic, intrinsic)
        np.testing.assert_allclose(uv, case.outputs["uv"][m], **CLOSE)
        one = add_views(none, patches[m : m + 1], extrinsic[None], intrinsic[None], positions)
        np.testing.assert_allclose(one, case.outputs["per_view"][m], **CLOSE)
    mean = add_views(none, patches, *cameras, positions) / len(patches)
    np.testing.assert_allclose(mean, case.outputs["mean"], **CLOSE)


def check_structure_flow_gradients(case):
    piece = convert_trellis("SparseStructureFlowModel", case.config, case.state)
    network = build("structure_flow", piece.model)
    x0, noise, t = last(case.inputs["x0"]), last(case.inputs["eps"]), case.inputs["t"]

    def loss(params):
        time = t.reshape(-1, 1, 1, 1, 1)
        x = (1 - time) * x0 + (SIGMA + (1 - SIGMA) * time) * noise
        v = network.apply(params, x, t, case.inputs["cond"])
        return jnp.square(v - ((1 - SIGMA) * noise - x0)).mean()

    compare_gradients("SparseStructureFlowModel", loss, piece, case)


def check_slat_encoder_gradients(case):
    piece = convert_trellis("SLatEncoder", case.config, case.state)
    network = slat_encoder(piece.model)
    batch, feats, rows = case.sparse()
    batch = with_plans(batch, piece.model)

    def loss(params):
        out = network.apply(params, feats, batch.coords, batch.plans, batch.counts)
        mean, logvar = jnp.split(out[rows], 2, -1)
        z = mean + jnp.exp(0.5 * logvar) * case.inputs["eps"]
        kl = 0.5 * (jnp.square(mean) + jnp.exp(logvar) - logvar - 1).mean()
        return jnp.square(z).mean() + KL_WEIGHT * kl

    compare_gradients("SLatEncoder", loss, piece, case)
    check_widened_encoder(piece, case, run_slat_encoder(piece, case))


def compare_gradients(name, loss, piece, case):
    # gradients have the parameters' names and layouts, so the converter takes them too; buffers
    # have none
    expected = flatten(convert_trellis(name, case.config, case.gradients).params)
    value, gradients = jax.jit(jax.value_and_grad(loss))(piece.params)
    np.testing.assert_allclose(value, case.outputs["loss"], rtol=1e-4)
    found = flatten(gradients)
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        atol = GRADIENT * np.abs(value).max()
        np.testing.assert_allclose(found[key], value, rtol=1e-4, atol=atol, err_msg=key)


CHECKS = {
    "ss_vae_encoder": check_structure_encoder,
    "ss_vae_smallact_encoder": check_structure_encoder,
    "ss_vae_decoder": check_structure_decoder,
    "ss_flow": check_structure_flow,
    "slat_encoder": check_slat_encoder,
    "slat_flow": check_latent_flow,
    "slat_dec_gs": check_gaussian_decoder,
    "dinov2": check_dinov2,
    "ops": check_ops,
    "features": check_features,
    "grads_ss_flow": check_structure_flow_gradients,
    "grads_slat_encoder": check_slat_encoder_gradients,
}


def check_of(stem):
    """The check of a fixture, by the longest prefix of its name.

    Raises:
      ValueError: none fits; a fixture that is not looked at must not count as passed.
    """
    fitting = [prefix for prefix in CHECKS if stem.startswith(prefix)]
    if not fitting:
        raise ValueError(f"{stem}.npz: no check for it; names start with {', '.join(CHECKS)}")
    return CHECKS[max(fitting, key=len)]
