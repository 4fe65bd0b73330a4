"""Image files: their headers, whether they are whole, and their pixels, upright. Pillow is touched here alone."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pillow_heif
from PIL import Image, UnidentifiedImageError

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.errors import DamagedPhotoError, FormatError, InputError, LostFileError, MissingFileError, is_away
from pomona.stages.capture.decoded_copies import DecodedCopies
from pomona.stages.capture.exif import Exif, parse_exif
from pomona.values.photos import Photo

pillow_heif.register_heif_opener()
# Pillow loads its readers at the first use; here, so that this does not happen in several threads at once.
Image.init()

# Phones have 200 megapixels by now; Pillow refuses files of twice this number, which would unpack to gigabytes.
Image.MAX_IMAGE_PIXELS = 250_000_000

# MPO is opened by the reader of JPEG: naming it here makes Pillow fail on every format that follows.
_FORMATS = ("JPEG", "PNG", "TIFF", "HEIF", "WEBP", "BMP")
# All that Pillow raises for files that are damaged, cut off or too large.
_READ_ERRORS = (
    OSError, ValueError, TypeError, SyntaxError, EOFError, RuntimeError, UnidentifiedImageError,
    Image.DecompressionBombError,
)  # fmt: skip
_NO_IMAGE = "this is no image in a format that can be read (JPEG, PNG, TIFF, HEIC)"
# Pillow's readers of these turn the pixels upright themselves, and give the upright size.
_TURNED = ("TIFF", "HEIF")
# These may have 16 bits a channel.
_DEEP = ("PNG", "TIFF")
# Colours of 16 bits a channel that are all below this are of a sensor of 12 bits or fewer, not moved up to the file's
# range: a photo whose brightest spot is at 1/16 of the range shows nothing in any other reading. At 1/4 of it (14 bits)
# it may be one taken at dusk, which is not to be brightened.
_LEAST_OF_16_BITS = 2**12
# What `cv2.rotate` and `cv2.flip` do for each EXIF orientation: (transpose, flip left-right, flip upside down).
_UPRIGHT = {1: "", 2: "x", 3: "xy", 4: "y", 5: "t", 6: "tx", 7: "txy", 8: "ty"}

_COPIES = DecodedCopies()


@dataclass(frozen=True)
class Header:
    """What an image file's header says: the upright size; `exif.orientation` is how its pixels are stored, as other
    programs have them.

    `file_state` is that of the file before it was looked into.
    """

    width_px: int
    height_px: int
    exif: Exif
    file_state: tuple[int, int]


def read_header(path: Path) -> Header:
    """Read the header of an image file and check that the file is whole, without decoding a pixel where possible.

    Raises `InputError` with the reason alone (for `Skipped.reason`) where the file cannot be used, and `LostFileError`
    where it is gone, or its disk does not answer.
    """
    try:
        state = file_state(path)
        if state[0] == 0:
            raise InputError("the file is empty (0 bytes)")
        with Image.open(path, formats=_FORMATS) as image:
            tags = image.getexif()
            exif = parse_exif(tags, tags.get_ifd(0x8769), tags.get_ifd(0x8825))
            turned = image.format in _TURNED
            width, height = image.size if turned or exif.orientation < 5 else image.size[::-1]
            whole = _is_whole(path, image)
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(_NO_IMAGE) from None
    except _READ_ERRORS as error:
        if isinstance(error, OSError) and is_away(error) and not isinstance(error, PermissionError):
            raise LostFileError(_lost(path, error)) from None
        raise InputError(f"the image cannot be read ({error})") from None
    if not whole:
        raise InputError("the image is truncated: its end is missing; copy the file again from the camera")
    # All programs turn HEIC, as the format itself says; TIFF they read as it is stored.
    return Header(width, height, replace(exif, orientation=1) if image.format == "HEIF" else exif, state)


def file_state(path: Path) -> tuple[int, int]:
    """Return the size in bytes of a file and when it was changed (ns): with others, it is another file."""
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns


def check_unchanged(photo: Photo, error: Exception | None = None) -> None:
    """Raise `LostFileError` where a photo's file is gone, out of reach, or not the one that its header was read from.

    Where no file of it has been seen before, one that is not there is a `MissingFileError`. `error` came of reading it.
    """
    try:
        if isinstance(error, OSError) and is_away(error):
            raise error
        changed = photo.file_state is not None and file_state(photo.path) != photo.file_state
    except OSError as away:
        if photo.file_state is None and isinstance(away, FileNotFoundError):
            raise MissingFileError(f"Photo {photo.name}: {photo.path} does not exist") from None
        raise LostFileError(_lost(photo.path, away)) from None
    if changed:
        raise LostFileError(_lost(photo.path))


def _lost(path: Path, error: OSError | None = None) -> str:
    """Say that a photo is gone, is out of reach, or (without `error`) has changed."""
    if error is None:
        what = "was changed while it was worked with"
    elif isinstance(error, FileNotFoundError):
        what = "was there and is gone"
    else:
        what = f"was there and cannot be reached any more ({error.strerror or error})"
    return (
        f"Photo {path} {what}: nothing was made of it. What was finished is kept; when the photos are as they are to "
        "be, the same command goes on from there"
    )


def size_of(path: Path) -> tuple[int, int]:
    """Return the upright width and height of a photo; raises `FormatError` naming it where it cannot be read."""
    try:
        header = read_header(path)
    except InputError as reason:
        raise FormatError(f"{path}: expected a photo: {reason}") from None
    return header.width_px, header.height_px


def read_pixels(photo: Photo, *, max_side_px: int | None = None) -> ByteArray:
    """Return a photo's pixels, uint8 (H, W, 3) RGB, upright, with its longer side at most `max_side_px`.

    Photos are never enlarged. JPEG is decoded at 1/2, 1/4 or 1/8 where that is still large enough, and brought to
    the exact size by area averaging: W = round(width_px * s), H = round(height_px * s), s = max_side_px / longer side.

    Raises `InputError` when it cannot be decoded, `LostFileError` when the file is gone, out of reach or not the one
    that the header was read from, and `MissingFileError` when none has been seen; all name it.
    """
    return _decoded(photo, max_side_px, "RGB")


def read_grey(photo: Photo, *, max_side_px: int | None = None) -> ByteArray:
    """Return how bright a photo's pixels are, uint8 (H, W); for the rest see `read_pixels`.

    Of JPEG colours are not even decoded, which takes half the time.
    """
    return _decoded(photo, max_side_px, "L")


def _decoded(photo: Photo, max_side_px: int | None, mode: Literal["RGB", "L"]) -> ByteArray:
    if max_side_px is not None and max_side_px < 1:
        raise InputError(f"`max_side_px`: expected at least 1, found {max_side_px}")
    scale = min(1.0, (max_side_px or np.inf) / max(photo.width_px, photo.height_px))
    size = max(1, round(photo.width_px * scale)), max(1, round(photo.height_px * scale))
    stored_size = size[::-1] if photo.orientation >= 5 else size
    try:
        with Image.open(photo.path, formats=_FORMATS) as image:
            if scale < 1 or mode == "L":
                image.draft(mode, stored_size)
            stored = _known_or_decoded(photo, image, mode)
            turned = image.format in _TURNED
    except _READ_ERRORS as error:
        check_unchanged(photo, error)
        # Pillow's own words name the file again.
        why = _NO_IMAGE if isinstance(error, UnidentifiedImageError) else error
        reason = f"its pixels cannot be decoded ({why})"
        raise DamagedPhotoError(f"Photo {photo.name} ({photo.path})", reason) from None
    check_unchanged(photo)
    pixels = stored if turned else _upright(stored, photo.orientation)
    if (pixels.shape[1], pixels.shape[0]) != size:
        if scale == 1.0:
            found = f"{pixels.shape[1]} × {pixels.shape[0]}"
            reason = f"expected {size[0]} × {size[1]} pixels, found {found}: file changed?"
            raise DamagedPhotoError(f"Photo {photo.name}", reason)
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    pixels = np.ascontiguousarray(pixels)
    return pixels.copy() if _COPIES.fits(stored) and np.may_share_memory(pixels, stored) else pixels


def _known_or_decoded(photo: Photo, image: Image.Image, mode: Literal["RGB", "L"]) -> ByteArray:
    """The pixels of an open image as they are stored, which may be kept in memory."""
    key = photo.path, photo.file_state, image.size, mode
    pixels = _COPIES.get(key)
    if pixels is None:
        pixels = _grey(image, photo.path) if mode == "L" else _rgb(image, photo.path)
        if photo.file_state is not None and _COPIES.fits(pixels):
            _COPIES.keep(key, pixels)
    return pixels


def write_jpeg(path: Path, pixels: ByteArray, *, quality: int = 95) -> None:
    """Write RGB pixels (H, W, 3) as a JPEG, under a temporary name first, so that a half-written one never stays."""
    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, "JPEG", quality=quality, subsampling=0)
    temporary = path.with_suffix(".part")
    temporary.write_bytes(encoded.getvalue())
    temporary.replace(path)


def _rgb(image: Image.Image, path: Path) -> ByteArray:
    """The image of a file as 8-bit RGB as it is stored (of more bits the highest eight that are used; transparency is
    dropped)."""
    if image.mode.startswith("I;16") or image.mode in ("I", "F"):
        return np.repeat(_of_eight_bits(np.asarray(image, np.float64))[:, :, None], 3, axis=2)
    pixels = np.asarray(image if image.mode == "RGB" else image.convert("RGB"), np.uint8)
    if image.format in _DEEP and pixels.max() < _LEAST_OF_16_BITS >> 8:
        return _of_used_bits(path, pixels)
    return pixels


def _of_used_bits(path: Path, upper: ByteArray) -> ByteArray:
    """The used bits of an image of 16 bits a channel, whose `upper` eight hold next to nothing; else these.

    Pillow has the upper eight alone. All of the file is looked at, so that a photo is as bright at every size.
    """
    deep = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if deep is None or deep.dtype != np.uint16 or deep.ndim != 3:
        return upper
    rgb = deep[:, :, 2::-1]
    # Turned and coloured otherwise than Pillow has it, it would be another picture.
    if not np.array_equal(rgb >> 8, upper):
        return upper
    return np.asarray(rgb >> (_bits_of(int(rgb.max())) - 8), np.uint8)


def _of_eight_bits(grey: FloatArray) -> ByteArray:
    """Grey values (H, W), as a sensor of 8 to 16 bits counts them, or from 0 to 1, as eight bits."""
    brightest = float(np.nanmax(grey, initial=0.0))
    if 0 < brightest <= 1:
        return np.asarray(np.nan_to_num(np.clip(255 * grey, 0, 255)), np.uint8)
    return np.asarray(np.nan_to_num(np.clip(grey / 2 ** (_bits_of(brightest) - 8), 0, 255)), np.uint8)


def _bits_of(brightest: float) -> int:
    """How many bits a sensor has, which files do not say: the least even number that holds the brightest value."""
    return next((bits for bits in (8, 10, 12, 14) if brightest < 2**bits), 16)


def _grey(image: Image.Image, path: Path) -> ByteArray:
    grey = image if image.mode == "L" else cv2.cvtColor(_rgb(image, path), cv2.COLOR_RGB2GRAY)
    return np.asarray(grey, np.uint8)


def _upright(pixels: Array, orientation: int) -> Array:
    for step in _UPRIGHT[orientation]:
        pixels = pixels.swapaxes(0, 1) if step == "t" else pixels[:, ::-1] if step == "x" else pixels[::-1]
    return pixels


def _is_whole(path: Path, image: Image.Image) -> bool:
    """Whether the file holds all of its image, from a few bytes of it where the format allows that."""
    size = path.stat().st_size
    if image.format in ("JPEG", "MPO"):
        return _jpeg_is_whole(path, size)
    if image.format == "PNG":
        with path.open("rb") as file:
            file.seek(max(0, size - 4096))
            return b"IEND" in file.read()
    if image.format == "HEIF":
        return _boxes_fit(path, size)
    if image.format == "TIFF":
        tags = image.tag_v2  # type: ignore[attr-defined]
        offsets, lengths = tags.get(273) or tags.get(324), tags.get(279) or tags.get(325)
        if offsets and lengths:
            pairs = zip(np.atleast_1d(offsets), np.atleast_1d(lengths), strict=True)
            return all(int(offset) + int(length) <= size for offset, length in pairs)
    image.load()
    return True


def _jpeg_is_whole(path: Path, size: int) -> bool:
    """Whether the main image's end (EOI, FF D9) is there; what may follow it (a second image, a video) is no matter."""
    with path.open("rb") as file:
        file.seek(max(0, size - 256))
        if file.read().rstrip(b"\0").endswith(b"\xff\xd9"):
            return True
        file.seek(0)
        data = file.read()
    # The header is made of segments with lengths, in which a thumbnail has an end of its own; skip them to the scan.
    at = 2
    while data[at : at + 1] == b"\xff" and at + 4 <= size:
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == 0xDA:
            break
    # In the scan every FF byte is followed by 00 or a restart marker, so that the first FF D9 is its end.
    return data.find(b"\xff\xd9", at) >= 0


def _boxes_fit(path: Path, size: int) -> bool:
    """Whether the top-level boxes of an ISO media file (HEIC) end where the file does, or before."""
    at = 0
    with path.open("rb") as file:
        while at + 8 <= size:
            file.seek(at)
            head = file.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            if length == 0:
                return True
            if length < 8:
                return False
            at += length
    return at <= size
