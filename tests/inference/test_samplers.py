"""The two samplers at toy size, with weights that answer to everything: batches, padding, views,
costs."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from uniart_jax.config import (
    Config,
    FlowConfig,
    GridConfig,
    LatentSampleConfig,
    LossConfig,
    ModelConfig,
    StructureVAEConfig,
    UniArtVAEConfig,
)
from uniart_jax.inference import samplers
from uniart_jax.inference.samplers import (
    flow_arguments,
    flow_inputs,
    join_views,
    make_conditioner,
    make_latent_sampler,
    make_structure_sampler,
    pad_coords,
)
from uniart_jax.models.image_encoder import pixel_width
from uniart_jax.models.network import build
from uniart_jax.training.flow_losses import make_structure_flow_loss, sample_noise_and_time
from uniart_jax.voxels.joint_code import canonical
from uniart_jax.voxels.read_layout import read_layout
from uniart_jax.voxels.typed_batches import Condition, StructureBatch

FLOW = FlowConfig(
    model_channels=24,
    num_blocks=1,
    num_heads=2,
    cond_channels=8,
    patch_size=2,
    volume_channels=3,
    volume_resolution=4,
    prediction="data",
)
MODEL = ModelConfig(
    grid=GridConfig(resolution=8, subdivisions=2, max_parts=4),
    structure_vae=StructureVAEConfig(channels=(4, 8), latent_channels=3),
    uniart_vae=UniArtVAEConfig(latent_channels=4),
    structure_flow=FLOW,
    latent_flow=dataclasses.replace(FLOW, stem="patch", voxel_channels=8),
)
OPTIONS = LatentSampleConfig(steps=3, guidance=1.5, guidance_interval=(0.5, 1.0), tolerance=0.3)
KEY = jax.random.key(0)
found_table = jax.jit(samplers.found_table, static_argnums=2)
PLAIN = (np.float32(0), np.float32(1))  # mean and deviation of the latents
rng = np.random.default_rng(0)


def weights(name, model=MODEL):
    """Random everywhere: layers that begin at zero would hide mistakes."""
    shapes = build(name, model).abstract()
    return jax.tree.map(lambda a: 0.1 * rng.normal(size=a.shape).astype(np.float32), shapes)


STRUCTURE, LATENT = weights("structure_flow"), weights("latent_flow")


def seen(items):
    return Condition(
        rng.normal(size=(items, 5, 8)).astype("f4"),
        rng.normal(size=(items, 4, 4, 4, 3)).astype("f4"),
    )


def with_solver(solver, adaptive):
    return dataclasses.replace(OPTIONS, solver=solver, adaptive=adaptive)


@pytest.mark.parametrize("solver", ["euler", "heun"])
def test_costs(solver):
    fixed = make_structure_sampler(MODEL, with_solver(solver, False))
    adaptive = make_structure_sampler(MODEL, with_solver(solver, True))
    condition = seen(2)
    found = fixed(STRUCTURE, PLAIN, condition, KEY)
    assert found.x.shape == (2, 4, 4, 4, 3) and np.isfinite(found.x).all()
    # Heun's last step ends below the time from which a predicted x_0 gives a velocity
    assert found.evaluations.tolist() == [{"euler": 3, "heun": 5}[solver]] * 2
    found = adaptive(STRUCTURE, PLAIN, condition, KEY)
    again = adaptive(STRUCTURE, PLAIN, condition, KEY)
    assert (found.evaluations > 3).all() and np.isfinite(found.x).all()
    np.testing.assert_array_equal(found.x, again.x)


def test_tighter_tolerances_cost_more_and_agree_more():
    """With many fixed steps of Heun as the truth."""
    condition = seen(2)

    def sampled(**changes):
        options = dataclasses.replace(OPTIONS, solver="heun", guidance=0.0, **changes)
        return make_structure_sampler(MODEL, options)(STRUCTURE, PLAIN, condition, KEY)

    truth = np.asarray(sampled(steps=100).x)
    loose, tight = (sampled(adaptive=True, tolerance=t) for t in (0.3, 0.03))
    errors = [np.sqrt(np.mean((np.asarray(a.x) - truth) ** 2)) for a in (loose, tight)]
    assert errors[1] < errors[0] and errors[1] < 0.05
    assert (tight.evaluations > loose.evaluations).all()


@pytest.mark.parametrize("solver", ["euler", "heun"])
def test_an_items_adaptive_steps_know_nothing_of_its_neighbours(solver):
    """Guided within an interval, that items enter at times of their own; the other item of the
    batch is exchanged."""
    sampler = make_latent_sampler(MODEL, with_solver(solver, True))
    coords = [np.argwhere(rng.random((8,) * 3) < s).astype(np.int32) for s in (0.2, 0.3, 0.4)]
    condition = seen(3)

    def sampled(items):
        padded, counts = pad_coords([coords[i] for i in items], (256,))
        part = jax.tree.map(lambda a: a[np.array(items)], condition)
        voxels = flow_inputs(padded, counts, MODEL)
        return jax.device_get(sampler(LATENT, PLAIN, part, KEY, voxels)), counts

    (first, counts), (second, _) = sampled([0, 1]), sampled([0, 2])
    n = int(counts[0])
    assert first.evaluations[0] == second.evaluations[0]
    np.testing.assert_allclose(first.x[0, :n], second.x[0, :n], atol=1e-4)
    assert not first.x[0, n:].any()  # padding
    assert np.abs(first.x[1] - second.x[1]).max() > 0.01


def test_padding_does_not_count_as_error():
    """The same voxels among more padding, with noise that is the same on them: the same steps."""
    coords = [np.argwhere(rng.random((8,) * 3) < 0.2).astype(np.int32)]
    condition, found = seen(1), []
    sampler = make_latent_sampler(MODEL, with_solver("heun", True))
    noise = rng.normal(size=(1, 512, 4)).astype("f4")
    for width in (128, 512):
        padded, counts = pad_coords(coords, (width,))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(jax.random, "normal", lambda key, shape: noise[:, : shape[1]])
            inputs = flow_inputs(padded, counts, MODEL)
            found.append(jax.device_get(sampler(LATENT, PLAIN, condition, KEY, inputs)))
    n = len(coords[0])
    assert found[0].evaluations.tolist() == found[1].evaluations.tolist()
    np.testing.assert_allclose(found[0].x[0, :n], found[1].x[0, :n], atol=1e-4)


def test_the_structure_flow_that_reads_pixels_samples_and_learns_through_the_camera():
    flow = dataclasses.replace(FLOW, pixel_channels=4)
    model = dataclasses.replace(MODEL, structure_flow=flow)
    params = weights("structure_flow", model)
    side = model.image_encoder.image_size
    encoder = weights("image_encoder", model)
    images = rng.random((2, side, side, 3)).astype(np.float32)
    condition = make_conditioner(model)(encoder, images)
    maps = condition.pixels, condition.cameras
    assert [m.shape[:2] for m in maps] == [(2, 1), (2, 1)]
    condition = seen(2)._replace(pixels=maps[0], cameras=np.array(maps[1]))
    moved = condition._replace(cameras=condition.cameras + 0.5 * np.eye(7, dtype="f4")[2])
    options = dataclasses.replace(OPTIONS, steps=1)
    sample = make_structure_sampler(model, options)
    one, other = (sample(params, PLAIN, c, KEY).x for c in (condition, moved))
    assert np.abs(one - other).max() > 1e-4

    config = Config(model=model, loss=LossConfig(condition_drop=0.0))
    loss = jax.jit(make_structure_flow_loss(build("structure_flow", model), config, *PLAIN))
    structure = rng.normal(size=(2, 4, 4, 4, 3)).astype(np.float32)
    one, other = (
        loss(params, StructureBatch(structure, seen=c), KEY)[0] for c in (condition, moved)
    )
    assert abs(float(one - other)) > 1e-6


def test_guidance_leads_away_from_no_picture_at_all():
    """One Euler step from noise by hand: v_c + w (v_c - v_u), where v_u sees zeros for tokens,
    volume, pictures and cameras."""
    model = dataclasses.replace(
        MODEL, latent_flow=dataclasses.replace(MODEL.latent_flow, pixel_channels=6)
    )
    network, params = build("latent_flow", model), weights("latent_flow", model)
    params |= {k: jax.tree.map(lambda a: 4 * a, v) for k, v in params.items() if "pixel" in k}
    maps = rng.normal(size=(1, 1, 8, 8, pixel_width(model.image_encoder))).astype("f4")
    cameras = np.array([[[0.6, 0.8, 0.4, 1.6, 0.3, 0, 0]]], np.float32)
    condition = seen(1)._replace(pixels=maps, cameras=cameras)
    coords = [np.argwhere(rng.random((8,) * 3) < 0.2).astype(np.int32)]
    padded, counts = pad_coords(coords, (128,))
    voxels, n = flow_inputs(padded, counts, model), len(coords[0])
    options = dataclasses.replace(OPTIONS, steps=1, guidance=1.5)
    found = make_latent_sampler(model, options)(params, PLAIN, condition, KEY, voxels).x
    noise = np.array(jax.random.normal(KEY, (1, 128, 4)))
    noise[:, n:] = 0

    def velocity(c):
        return np.asarray(seen_velocity(c))

    @jax.jit
    def seen_velocity(c):
        one = np.ones(1, np.float32)
        given = flow_arguments(voxels, c)
        return network.apply(params, noise, one, c.tokens, c.volume, **given)

    nothing = jax.tree.map(np.zeros_like, condition)
    with_image, without = velocity(condition), velocity(nothing)
    expected = noise - (with_image + 1.5 * (with_image - without))
    np.testing.assert_allclose(found, expected, atol=2e-4)
    blind = condition._replace(pixels=nothing.pixels, cameras=nothing.cameras)
    assert np.abs(velocity(blind) - with_image).max() > 1e-2


@pytest.mark.parametrize("kind", ["structure", "latent"])
def test_samples_are_given_the_latents_mean_and_deviation(kind):
    """A flow knows latents of mean 0 and deviation 1; what is returned is in the VAE's units."""
    options = dataclasses.replace(OPTIONS, steps=1, guidance=0.0)
    if kind == "structure":
        sampler, given, channels = make_structure_sampler(MODEL, options), (), 3
    else:
        coords = [np.argwhere(rng.random((8,) * 3) < 0.2).astype(np.int32)]
        given, channels = (flow_inputs(*pad_coords(coords, (128,)), MODEL),), 4
        sampler = make_latent_sampler(MODEL, options)
    params, condition = STRUCTURE if kind == "structure" else LATENT, seen(1)
    mean, std = rng.normal(2, 1, channels).astype("f4"), rng.uniform(0.5, 3, channels).astype("f4")
    zero, one = np.zeros_like(mean), np.ones_like(std)
    normal = np.asarray(sampler(params, (zero, one), condition, KEY, *given).x)
    found = np.asarray(sampler(params, (mean, std), condition, KEY, *given).x)
    expected = normal * std + mean
    if kind == "latent":
        expected[:, len(coords[0]) :] = 0
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("kind", ["structure", "latent"])
def test_outside_its_interval_guidance_changes_nothing(kind):
    """Of three steps the first is at t = 1 and the last at .6: an interval that holds none, or
    one."""
    condition = seen(1)
    coords = [np.argwhere(rng.random((8,) * 3) < 0.2).astype(np.int32)]
    voxels = flow_inputs(*pad_coords(coords, (128,)), MODEL)
    loud = jax.tree.map(lambda a: 3 * a, LATENT)  # so that the condition is heard

    def sampled(guidance, interval):
        options = dataclasses.replace(OPTIONS, guidance=guidance, guidance_interval=interval)
        if kind == "structure":
            found = make_structure_sampler(MODEL, options)(STRUCTURE, PLAIN, condition, KEY)
        else:
            found = make_latent_sampler(MODEL, options)(loud, PLAIN, condition, KEY, voxels)
        return np.asarray(found.x)

    plain = sampled(0.0, (0.0, 1.0))
    np.testing.assert_allclose(sampled(5.0, (0.1, 0.5)), plain, atol=1e-5)
    some, everywhere = sampled(5.0, (0.99, 1.0)), sampled(5.0, (0.0, 1.0))
    assert np.abs(some - plain).max() > 0.01 and np.abs(everywhere - some).max() > 0.01


def test_the_supplements_direction_is_the_mirror_image():
    """z_0 prior, z_1 data: z_s = (1 - s) z_0 + s z_1, velocity z_1 - z_0, sampled from s = 0 to 1;
    written out here, with the same network."""
    text = dataclasses.replace(
        MODEL, structure_flow=dataclasses.replace(FLOW, prediction="velocity")
    )
    flow = dataclasses.replace(text.structure_flow, direction="noise_to_data")
    mirror = dataclasses.replace(text, structure_flow=flow)
    raw, ours = build("structure_flow", text), build("structure_flow", mirror)
    condition = seen(2)
    x = rng.normal(size=(2, 4, 4, 4, 3)).astype("f4")
    config = Config(model=mirror, loss=LossConfig(condition_drop=0.0))
    loss_fn = make_structure_flow_loss(ours, config, *PLAIN)
    batch = StructureBatch(x, seen=Condition(condition.tokens, condition.volume))

    @jax.jit
    def run(params, x):
        def velocity(z, s):  # the supplement's v(z, s | c)
            return raw.apply(params, z, s, condition.tokens, condition.volume)

        t, noise, _ = sample_noise_and_time(batch.seen, x, KEY, config)
        s = 1 - t
        z = (1 - s)[:, None, None, None, None] * noise + s[:, None, None, None, None] * x
        loss = jnp.square(velocity(z, s) - (x - noise)).mean()
        z, steps = jax.random.normal(KEY, x.shape), 3
        for i in range(steps):
            z = z + velocity(z, jnp.full(2, i / steps)) / steps
        same = ours.apply(params, x, t, condition.tokens, condition.volume), -velocity(x, s)
        return (loss, loss_fn(params, batch, KEY)[0]), z, same

    (expected, found), z, (out, reflected) = run(STRUCTURE, x)
    assert float(found) == pytest.approx(float(expected), rel=1e-5)
    np.testing.assert_allclose(out, reflected, atol=1e-5)
    options = dataclasses.replace(OPTIONS, steps=3, rescale_t=1.0, guidance=0.0)
    sampled = make_structure_sampler(mirror, options)(STRUCTURE, PLAIN, condition, KEY).x
    np.testing.assert_allclose(sampled, z, atol=1e-4)
    other = make_structure_sampler(text, options)(STRUCTURE, PLAIN, condition, KEY).x
    assert np.abs(np.asarray(other) - z).max() > 0.01


@pytest.mark.parametrize("views", [2, 3])
def test_several_views_are_one_condition(views):
    """Tokens and maps side by side, volumes averaged; their order does not matter, and none is left
    out."""
    condition = seen(views)
    closely = condition._replace(
        pixels=rng.normal(size=(views, 1, 8, 8, 3)), cameras=rng.normal(size=(views, 1, 7))
    )
    together = join_views(closely)
    np.testing.assert_array_equal(together.pixels[0], closely.pixels[:, 0])
    np.testing.assert_array_equal(together.cameras[0], closely.cameras[:, 0])
    joined = join_views(condition)
    assert joined.pixels is None
    assert joined.tokens.shape == (1, 5 * views, 8) and joined.volume.shape == (1, 4, 4, 4, 3)
    np.testing.assert_allclose(joined.volume[0], condition.volume.mean(0), atol=1e-6)
    both = Condition(*(np.concatenate([v, v[::-1] + 1]) for v in closely[:4]))
    pair = join_views(both, items=2)
    for k, views_of in enumerate((slice(views), slice(views, None))):
        alone = join_views(Condition(*(v[views_of] for v in both[:4])))
        for one, other in zip(alone[:4], pair[:4], strict=True):
            np.testing.assert_allclose(other[k], one[0], atol=1e-6)
    sampler = make_structure_sampler(MODEL, OPTIONS)

    def sampled(order):
        some = Condition(condition.tokens[order], condition.volume[order])
        return np.asarray(sampler(STRUCTURE, PLAIN, join_views(some), KEY).x)

    everything = list(range(views))
    a = sampled(everything)
    np.testing.assert_allclose(a, sampled(everything[::-1]), atol=1e-4)
    for left_out in everything:
        others = [v for v in everything if v != left_out]
        assert np.abs(a - sampled(others)).max() > 0.01


def test_found_layouts_are_the_parts_that_exist_the_surest_first():
    generator = np.random.default_rng(1)
    lower = generator.uniform(-0.5, 0, (2, 5, 3))
    parts = {
        "corners": np.concatenate([lower, lower + generator.uniform(0.1, 0.5, (2, 5, 3))], -1),
        "codes": generator.normal(size=(2, 5, 9)),
        "exists": np.array([[-2.0, -0.3, 3.0, -0.5, 2.0], [-5.0, -4.0, -9.0, -1.0, -6.0]]),
        "colors": generator.random((2, 5, 3)),
    }
    parts["codes"][0, 4, 1:4] = 0.1  # no axis: fixed
    parents = np.full((2, 5, 5), -3.0)
    parents[0, 2, 2] = parents[0, 1, 2] = parents[0, 4, 1] = 3  # the root, its child, a grandchild
    parents[0, 4, 3] = 9  # a row that does not exist is no parent
    table = jax.device_get(found_table(parts, parents, 4))
    assert table.counts.tolist() == [3, 1]  # one part there is always
    for b, rows in enumerate(([2, 4, 1], [3])):
        layout = read_layout(
            {
                name: v[b]
                for name, v in (parts | {"parents": parents, "camera": parents[:, 0]}).items()
            }
        )
        at = np.argsort(rows)  # rows of ``layout`` are in the order of the queries
        np.testing.assert_allclose(table.boxes[b, : len(rows)][at], layout.boxes, atol=1e-6)
        np.testing.assert_allclose(table.colors[b, : len(rows)][at], layout.colors, atol=1e-6)
        assert not any(np.asarray(values)[b, len(rows) :].any() for values in table[:-1])
    assert table.parents[0].tolist() == [0, 2, 0, 0]
    codes = np.asarray(table.codes[0])
    assert not codes[0].any() and not codes[1].any()  # the root, and what has no axis
    np.testing.assert_allclose(codes[2], canonical(parts["codes"][0, 1]), atol=1e-5)
    few = jax.device_get(found_table(parts, parents, 2))
    assert few.counts.tolist() == [2, 1] and few.parents[0].tolist()[0] == 0
