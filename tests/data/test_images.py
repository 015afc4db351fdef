"""Bad and odd input images (docs/files.md, "Bad input")."""

import numpy as np
import pytest
from PIL import EpsImagePlugin, Image, PngImagePlugin

from uniart_jax.data.background import cut_out
from uniart_jax.data.images import crop, read_image, remove_plain_background


def object_on(background, size=(64, 96), alpha=None):
    image = np.zeros((*size, 4), np.uint8)
    image[..., :3] = background
    image[..., 3] = 255 if alpha is None else alpha
    image[20:40, 30:70] = (200, 30, 30, 255)
    return image


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.png", b"", "empty"),
        ("text.png", b"not an image at all, just text", "not an image"),
    ],
)
def test_unreadable_files_give_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message) as error:
        read_image(tmp_path / name)
    assert "\n" not in str(error.value)


EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 32 32\n%%EndComments\n%%EOF\n"


@pytest.mark.parametrize("name", ["a.eps", "a.png"])
def test_postscript_is_never_run(tmp_path, monkeypatch, name):
    def run(*_, **__):
        raise AssertionError("Ghostscript was asked")

    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", run)
    (tmp_path / name).write_bytes(EPS)
    assert Image.open(tmp_path / name).format == "EPS"  # Pillow would take it
    with pytest.raises(ValueError, match=rf"{name}': not an image that can be read"):
        read_image(tmp_path / name)


def test_a_text_beside_a_picture_that_inflates_without_end_names_the_file(tmp_path):
    texts = PngImagePlugin.PngInfo()
    texts.add_text("comment", "x" * (4 * 2**20), zip=True)
    Image.new("RGB", (32, 32)).save(tmp_path / "bomb.png", pnginfo=texts)
    with pytest.raises(ValueError, match=r"^image '.*bomb\.png': ") as caught:
        read_image(tmp_path / "bomb.png")
    assert "\n" not in str(caught.value)


def test_missing_and_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_image(tmp_path / "absent.png")
    with pytest.raises(ValueError, match="not a file"):
        read_image(tmp_path)


def test_truncated_png(tmp_path):
    path = tmp_path / "cut.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)).save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(ValueError, match="truncated or damaged"):
        read_image(path)


def test_one_pixel_and_huge(tmp_path):
    Image.new("RGB", (1, 1)).save(tmp_path / "one.png")
    with pytest.raises(ValueError, match="too small"):
        read_image(tmp_path / "one.png")
    Image.new("1", (20_000, 6_000)).save(tmp_path / "huge.png")
    with pytest.raises(ValueError, match="megapixels"):
        read_image(tmp_path / "huge.png")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "TGA"])
def test_common_formats_are_read_whatever_the_file_is_called(tmp_path, kind):
    Image.new("RGB", (32, 16), (250, 0, 0)).save(tmp_path / "a.image", kind)
    assert read_image(tmp_path / "a.image")[8, 8, 0] > 230


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "CMYK", "1", "I;16"])
def test_modes_keep_bright_and_dark(tmp_path, mode):
    ramp = np.linspace(0, 255, 64).astype(np.uint8)[None].repeat(32, 0)
    if mode == "I;16":
        image = Image.fromarray(ramp.astype(np.uint16) * 257)
    else:
        image = Image.fromarray(ramp).convert(mode)
    path = tmp_path / ("x.tif" if mode == "CMYK" else "x.png")
    image.save(path)
    rgba = read_image(path)
    assert rgba.shape == (32, 64, 4) and rgba.dtype == np.uint8
    assert rgba[:, -4:, :3].mean() > 200 and rgba[:, :4, :3].mean() < 60


def test_exif_rotation(tmp_path):
    image = Image.new("RGB", (40, 20), "white")
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(tmp_path / "turned.jpg", exif=exif)
    assert read_image(tmp_path / "turned.jpg").shape[:2] == (40, 20)


def test_plain_background_is_removed_and_holes_stay():
    image = object_on((240, 240, 240))
    image[28:32, 45:55, :3] = 240  # a hole of the background's colour inside the object is kept
    cut = remove_plain_background(image)
    assert cut is not None
    assert (cut[..., 3] > 0).sum() == 20 * 40


def test_busy_background_warns(monkeypatch):
    monkeypatch.setattr("uniart_jax.data.background._installed", lambda *modules: False)
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3))
    image = np.dstack([noise, np.full((64, 64), 255)]).astype(np.uint8)
    with pytest.warns(UserWarning, match="whole image"):
        assert (cut_out(image)[0][..., 3] == 255).all()


def test_transparent_throughout():
    with pytest.raises(ValueError, match="transparent"):
        cut_out(np.zeros((32, 32, 4), np.uint8))


@pytest.mark.parametrize("size", [(64, 96), (16, 900), (900, 16)])
def test_crop_centres_the_object(size):
    image = np.zeros((*size, 4), np.uint8)
    image[4:12, 4:12] = 255
    out = crop(image, 66)
    assert out.shape == (66, 66, 3)
    assert abs(int((out[..., 0] > 127).sum()) - 60 * 60) < 300
    np.testing.assert_allclose(out, out[:, ::-1], atol=2)


def test_crop_commutes_with_mirroring():
    rng = np.random.default_rng(1)
    image = np.zeros((50, 70, 4), np.uint8)
    image[10:30, 13:40, :3] = rng.integers(0, 255, (20, 27, 3))
    image[10:30, 13:40, 3] = 255
    np.testing.assert_allclose(
        crop(image[:, ::-1], 32).astype(int), crop(image, 32)[:, ::-1].astype(int), atol=3
    )


def test_a_long_panorama_needs_no_square_of_its_length():
    image = np.zeros((40, 60_000, 4), np.uint8)
    image[10:30, 100:59_900] = 255
    out = crop(image, 64)  # a square canvas of this would hold 3.6 billion pixels
    assert out.shape == (64, 64, 3) and out[31:33, 8:56].max() > 10


def test_pixels_outside_the_foreground_do_not_matter():
    rng = np.random.default_rng(0)
    image = np.zeros((80, 90, 4), np.uint8)
    image[20:60, 30:70, :3] = rng.integers(0, 255, (40, 40, 3))
    image[20:60, 30:70, 3] = 255
    larger = np.zeros((200, 300, 4), np.uint8)
    larger[50:130, 60:150] = image
    np.testing.assert_array_equal(crop(image, 32), crop(larger, 32))
