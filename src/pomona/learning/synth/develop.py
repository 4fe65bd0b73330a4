"""From a render to a photo: sensor noise, a little blur, white balance, JPEG with EXIF."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from pomona.learning.synth.options import RowOptions

_CROP = 1.6  # of an APS-C sensor, over 35 mm film
_EXIF_IFD, _MAKE, _MODEL, _SOFTWARE, _FOCAL, _FOCAL_35MM, _TAKEN, _ORIENTATION = (
    0x8769, 0x010F, 0x0110, 0x0131, 0x920A, 0xA405, 0x9003, 0x0112,
)  # fmt: skip


def develop(render: Path, photo: Path, options: RowOptions, *, number: int) -> None:
    """Write the `number`-th photo of a row from its render (PNG)."""
    rng = options.visit_rng(1000 + number)
    setting = options.visit_rng(900)  # one camera setting for the whole row
    balance, saturation = np.exp(setting.normal(0, 0.035, 3)), setting.uniform(1.0, 1.3)
    with Image.open(render) as image:
        soft = image.convert("RGB").filter(ImageFilter.GaussianBlur(0.35))
    pixels = np.asarray(soft, float) * balance
    grey = pixels @ np.array([0.299, 0.587, 0.114])
    pixels = grey[..., None] + saturation * (pixels - grey[..., None])
    noise = rng.normal(0, 1, pixels.shape) * (1.0 + 0.012 * np.clip(pixels, 0, 255))
    Image.fromarray(np.clip(pixels + noise, 0, 255).astype(np.uint8)).save(
        photo, quality=options.jpeg_quality, exif=_exif(options, number), subsampling="4:2:0"
    )


def _exif(options: RowOptions, number: int) -> Image.Exif:
    taken = datetime(2024, 9, 1, 10) + timedelta(days=options.seed % 40 + options.days_later, seconds=3 * number)
    exif = Image.Exif()
    exif[_MAKE], exif[_MODEL], exif[_SOFTWARE], exif[_ORIENTATION] = "Pomona", "Rendered APS-C", "pomona synth", 1
    details = exif.get_ifd(_EXIF_IFD)
    details[_FOCAL] = round(options.focal_35mm / _CROP, 2)
    details[_FOCAL_35MM] = options.focal_35mm
    details[_TAKEN] = taken.strftime("%Y:%m:%d %H:%M:%S")
    return exif
