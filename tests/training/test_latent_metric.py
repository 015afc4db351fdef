import numpy as np
from hand_records import write_latents

from uniart_jax.data.prepare import prepare_procedural
from uniart_jax.data.records import RecordSource, decode_color, decode_sdf
from uniart_jax.precompute.encoding import latent_metric
from uniart_jax.training.latent_metric import WEIGHTS, fit_metric
from uniart_jax.voxels.part_table import EMPTY

RNG = np.random.default_rng(0)
WIDTHS = {"own_box": 6, "joint_code": 9, "parent_box": 6, "color": 3, "sdf": 8}


def _world(n=4000, channels=8):
    """Latents of uneven channels whose last one says nothing, and attributes that are linear in the
    others."""
    z = RNG.normal(size=(n, channels)) * np.linspace(0.2, 3, channels) + 5
    maps = {name: RNG.normal(size=(channels - 1, d)) for name, d in WIDTHS.items()}
    return z, {name: z[:, :-1] @ w + 2 for name, w in maps.items()}


def _size(metric, errors):
    return np.einsum("nc,cd,nd->n", errors, metric, errors).mean()


def test_the_mean_as_a_guess_costs_one_and_a_silent_channel_almost_nothing():
    z, attributes = _world()
    scaled = (z - z.mean(0)) / z.std(0)
    for share in (0.0, 0.5, 0.9):
        metric = fit_metric(z, attributes, share)
        np.testing.assert_allclose(_size(metric, scaled), 1, rtol=2e-3)
        silent = np.zeros_like(z)
        silent[:, -1] = 1
        np.testing.assert_allclose(_size(metric, silent), (1 - share) / z.shape[1], atol=2e-3)
        assert np.linalg.eigvalsh(metric).min() >= -1e-6
    assert sum(WEIGHTS.values()) == 1


def test_an_error_counts_as_the_attributes_that_it_spoils():
    z, attributes = _world()
    only_box = {k: v if k == "own_box" else RNG.normal(size=v.shape) for k, v in attributes.items()}
    metric = fit_metric(z, only_box, 1.0)
    errors = RNG.normal(size=(1, z.shape[1])) * 0.1
    spoiled = (errors * z.std(0)) @ np.linalg.lstsq(
        z - z.mean(0), only_box["own_box"] - only_box["own_box"].mean(0), rcond=None
    )[0]
    expected = WEIGHTS["own_box"] * np.square(spoiled).sum() / only_box["own_box"].var(0).sum()
    np.testing.assert_allclose(_size(metric, errors), expected, rtol=0.05)


def test_metric_of_stored_latents_is_that_of_their_own_voxels(tmp_path):
    records = prepare_procedural(
        tmp_path / "records", 2, image_size=16, processes=1, progress=False
    )
    source = RecordSource(records)
    attribute = RNG.normal(size=(15, 4))

    def items():
        for i in (1, 0):  # stored in another order than the records
            record = source[i]
            part = record.voxel_part.astype(int)
            known = np.concatenate([record.boxes[part], record.codes[part]], -1)
            yield {
                "record": i,
                "mirrored": False,
                "structure": np.zeros((1, 1, 1, 2)),
                "coords": record.coords,
                "voxel_part": record.voxel_part,
                "latent": known @ attribute,
                "images": record.images[..., :3],
                **EMPTY,
            }

    write_latents(tmp_path / "latents", items(), key="k")
    found = latent_metric(tmp_path / "latents", records, 0.8)
    rows = {name: [] for name in ("latent", *WEIGHTS)}
    for i in range(2):
        record = source[i]
        part = record.voxel_part.astype(int)
        rows["latent"].append(
            np.concatenate([record.boxes[part], record.codes[part]], -1) @ attribute
        )
        rows["own_box"].append(record.boxes[part])
        rows["joint_code"].append(record.codes[part])
        rows["parent_box"].append(record.boxes[record.parents[part]])
        rows["color"].append(decode_color(record.color).mean(1))
        rows["sdf"].append(decode_sdf(record.sdf))
    # all voxels here, some drawn there
    number = min(len(v) for v in rows["latent"])
    assert number > 500
    joined = {k: np.concatenate([x[:: len(x) // 500] for x in v]) for k, v in rows.items()}
    expected = fit_metric(joined.pop("latent"), joined, 0.8)
    np.testing.assert_allclose(found, expected, atol=0.25 * np.abs(expected).max())
    assert np.abs(found).max() > 2 * 0.2 / 4
