"""Key frames of a video: sharp ones, a small step apart, however fast or slowly the person walked."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pomona.basics.arrays import Array
from pomona.errors import InputError
from pomona.progress import Progress
from pomona.stages.capture.images import write_jpeg
from pomona.stages.capture.keyframes import Frame, KeyFrameOptions, choose, sharpness

_MANIFEST = "frames.json"
_QUIET = "-8"  # FFmpeg's AV_LOG_QUIET
_ROUNDED = 0.97  # of the time between two frames of 30 a second, which Matroska has in whole milliseconds
_AS_SQUARE = 0.01  # pixels whose sides differ by less are square: programs round sizes, and write what is left so
_FARTHEST_FROM_SQUARE = 2.5  # the widest pixels that cameras have are twice as wide as high
_VERSION = 4  # of `frames.json` and of how frames are chosen: another one takes them anew


@dataclass(frozen=True)
class KeyFrame:
    """One key frame as a file: its name, its 0-based index and its time in the video, its size, its file's digest."""

    name: str
    frame_idx: int
    time_s: float
    width_px: int
    height_px: int
    digest: str

    @classmethod
    def of(cls, path: Path, frame_idx: int, time_s: float, width_px: int, height_px: int) -> KeyFrame:
        """Return the key frame that was written to a file."""
        return cls(path.name, frame_idx, time_s, width_px, height_px, _digest_of_frame(path))


def is_video(path: Path) -> bool:
    """Say from its first bytes whether a file is a video (MP4, MOV, AVI, Matroska, WebM, MPEG), whatever its name."""
    with path.open("rb") as file:
        head = file.read(64)
    if head[4:8] == b"ftyp":
        return head[8:12] not in (b"heic", b"heix", b"mif1", b"msf1", b"hevc", b"hevx", b"avif")
    return (
        head[4:8] in (b"moov", b"mdat", b"wide", b"free", b"skip")
        or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")
        or head[:4] in (b"\x1aE\xdf\xa3", b"\x00\x00\x01\xba", b"\x00\x00\x01\xb3", b"FLV\x01", b"OggS")
        or (head[:1] == b"G" and len(head) > 4 and path.suffix.lower() in (".ts", ".mts", ".m2ts"))
        or (head[4:5] == b"G" and path.suffix.lower() in (".mts", ".m2ts"))
        or head[:16] == bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")
    )


def extract_key_frames(
    video: Path, frames_dir: Path, progress: Progress, options: KeyFrameOptions
) -> tuple[KeyFrame, ...]:
    """Choose key frames of a video and write them as `frames_dir/frame_000123.jpg` (the number is the frame's index).

    Frames already written from the same video with the same options are used again, unless one of them is not as it was
    written. The video's rotation is applied, and pixels that are not square, as some camcorders store them, become so.
    `frames.json` beside the frames holds what the video was, the options and the frames' times.

    Raises `InputError` when the video cannot be decoded.
    """
    made_from: dict[str, Any] = {"version": _VERSION, "video": _digest(video), "options": asdict(options)}
    if whole := read_frame_list(frames_dir, made_from):
        return whole
    known = _read_manifest(frames_dir)
    for stale in known["frames"] if known else ():
        (frames_dir / stale["name"]).unlink(missing_ok=True)
    frames_dir.mkdir(parents=True, exist_ok=True)
    frames = []
    for frame in choose(_decode(video, options, progress), options):
        name = f"frame_{frame.frame_idx:06d}.jpg"
        write_jpeg(frames_dir / name, frame.pixels[:, :, ::-1], quality=options.jpeg_quality)
        height, width = frame.pixels.shape[:2]
        frames.append(KeyFrame.of(frames_dir / name, frame.frame_idx, round(frame.time_s, 4), width, height))
    # The manifest is written last: without it the frames are made anew.
    write_frame_list(frames_dir, made_from, frames)
    return tuple(frames)


def write_frame_list(frames_dir: Path, made_from: Mapping[str, Any], frames: Sequence[KeyFrame]) -> None:
    """Write `frames.json` beside frames."""
    partial = frames_dir / (_MANIFEST + ".part")
    partial.write_text(json.dumps({"made_from": made_from, "frames": [asdict(f) for f in frames]}, indent=1), "utf-8")
    partial.replace(frames_dir / _MANIFEST)


def read_frame_list(frames_dir: Path, made_from: Mapping[str, Any]) -> tuple[KeyFrame, ...]:
    """Return the frames in a folder; none where they were made from something else, or are not as they were written."""
    known = _read_manifest(frames_dir)
    return _whole_frames(frames_dir, known["frames"]) if known and known["made_from"] == made_from else ()


def _digest(video: Path) -> str:
    size = video.stat().st_size
    digest = hashlib.sha256(str(size).encode())
    with video.open("rb") as file:
        digest.update(file.read(1 << 20))
        file.seek(max(0, size - (1 << 20)))
        digest.update(file.read())
    return digest.hexdigest()


def _whole_frames(frames_dir: Path, listed: list[dict[str, Any]]) -> tuple[KeyFrame, ...]:
    """The frames that are listed; none where the list is damaged, or one of them is not as it was written."""
    try:
        frames = tuple(KeyFrame(**frame) for frame in listed)
        whole = all(_digest_of_frame(frames_dir / frame.name) == frame.digest for frame in frames)
    except (OSError, TypeError, ValueError):
        return ()
    return frames if whole else ()


def _digest_of_frame(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read_manifest(frames_dir: Path) -> dict[str, Any] | None:
    try:
        manifest = json.loads((frames_dir / _MANIFEST).read_text(encoding="utf-8"))
        # Names are used to remove files: in a folder that somebody else made, they may lead anywhere.
        plain = all(frame["name"] == Path(frame["name"]).name for frame in manifest["frames"])
        return manifest if plain and "made_from" in manifest else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _decode(video: Path, options: KeyFrameOptions, progress: Progress) -> Iterator[Frame]:
    """Yield the video's frames, upright, at most `options.most_per_s` a second."""
    if video.stat().st_size == 0:
        raise InputError(f"{video} cannot be decoded: the file is empty (0 bytes). Copy it again from the camera")
    # FFmpeg writes to the terminal itself, into progress and messages; what matters of that is said here.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", _QUIET)
    capture = cv2.VideoCapture(str(video))
    try:
        if not capture.isOpened():
            raise InputError(_undecodable(video))
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        stretch = _stretch(capture)
        rate = capture.get(cv2.CAP_PROP_FPS)
        rate = rate if np.isfinite(rate) and rate > 0 else 30.0
        stride = max(1, round(rate / options.most_per_s))
        total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        progress.start(f"Choosing key frames of {video.name}", total if total > 0 else None)
        index, time_s, looked_at, looked_at_s = 0, 0.0, -stride, -np.inf
        while capture.grab():
            progress.advance()
            stamp_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000  # 0 where a frame has none
            time_s = max(time_s, stamp_s if stamp_s > 0 else index / rate)
            # Screen recorders and browsers write frames as they come: the rate may be that of the first of them alone.
            if index - looked_at >= stride or time_s - looked_at_s >= _ROUNDED / options.most_per_s:
                looked_at, looked_at_s = index, time_s
                decoded, pixels = capture.retrieve()
                if decoded and pixels is not None:
                    yield _looked_at(index, time_s, _stretched(pixels, stretch), options)
            index += 1
        if index == 0:
            raise InputError(_undecodable(video))
        # Some containers have no count: it is worked out from the rate, and time alone tells what is missing.
        if total > 0 and index < 0.9 * total and time_s < 0.9 * total / rate:
            progress.warn(f"{video}: only {index} of {total} frames could be decoded; is the file complete?")
    finally:
        capture.release()


def _stretch(capture: cv2.VideoCapture) -> tuple[float, float]:
    """By what the width and the height of upright frames are to be multiplied, so that their pixels are square."""
    width, height = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    aspect = width / height if width > 0 and height > 0 else 1.0
    if abs(aspect - 1) < _AS_SQUARE or not 1 / _FARTHEST_FROM_SQUARE < aspect < _FARTHEST_FROM_SQUARE:
        return 1.0, 1.0
    stretch = max(aspect, 1.0), max(1 / aspect, 1.0)
    lies = capture.get(cv2.CAP_PROP_ORIENTATION_META) % 180 == 90  # the aspect is of frames as they are stored
    return stretch[::-1] if lies else stretch


def _stretched(pixels: Array, stretch: tuple[float, float]) -> Array:
    if stretch == (1.0, 1.0):
        return pixels
    return np.asarray(cv2.resize(pixels, None, fx=stretch[0], fy=stretch[1], interpolation=cv2.INTER_CUBIC))


def _undecodable(video: Path) -> str:
    return (
        f"{video} cannot be decoded as a video: the file is damaged, incomplete, or its codec is unknown here. "
        "Convert it to MP4 with H.264, or give a folder of its frames"
    )


def _looked_at(index: int, time_s: float, pixels: Array, options: KeyFrameOptions) -> Frame:
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    scale = min(1.0, options.work_side_px / max(grey.shape))
    if scale < 1:
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Frame(index, time_s, pixels, np.asarray(grey, np.uint8), sharpness(grey))
