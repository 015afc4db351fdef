"""Our networks against upstream's own outputs: every fixture of a folder (``parity_cases``), each
by the check of its kind (``parity_checks``)."""

import numpy as np
import pytest
from drawn import draw_quickly
from parity_cases import FOLDER, SHIPPED, cases, load
from parity_checks import CHECKS, check_of


@pytest.fixture(autouse=True)
def drawn_quickly(monkeypatch):
    """What upstream does not fill may be anything here."""
    draw_quickly(monkeypatch)


@pytest.mark.parametrize("path", cases(FOLDER), ids=lambda path: path.stem)
def test_parity(path):
    check_of(path.stem)(load(path))


def test_the_shipped_fixtures_cover_every_network():
    stems = [path.stem.removeprefix("grads_") for path in cases(SHIPPED)]
    seen = {check_of(stem) for stem in stems}
    assert seen == {check for prefix, check in CHECKS.items() if not prefix.startswith("grads_")}


def test_unknown_fixtures_and_empty_folders_fail(tmp_path):
    with pytest.raises(FileNotFoundError, match="no parity fixtures"):
        cases(tmp_path)
    with pytest.raises(ValueError, match=r"slat_dec_mesh\.npz: no check"):
        check_of("slat_dec_mesh")
    assert check_of("ss_flow_smallact") is CHECKS["ss_flow"]
    assert check_of("grads_ss_flow") is CHECKS["grads_ss_flow"]


@pytest.mark.parametrize("stem", ["ss_vae_decoder_small", "grads_slat_encoder"])
def test_a_wrong_weight_is_seen(stem):
    """The tolerances mean something: a hundredth of one weight's size is enough to fail."""
    case = load(SHIPPED / f"{stem}.npz")
    name = "blocks.0.conv1.weight" if "vae" in stem else "blocks.0.attn.to_qkv.weight"
    case.state[name] = case.state[name].copy()
    case.state[name].flat[7] += 0.01 * np.abs(case.state[name]).max()
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        check_of(stem)(case)
