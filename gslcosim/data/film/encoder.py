"""Encoder of frames: MP4, or an animated GIF or WebP."""

import os
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.errors import UsageError
from gslcosim.data.film.keyframes import FRAMES_PER_S

REMEDY = "pip install 'gslcosim[film]'"
FORMATS = (".mp4", ".gif", ".webp")
# Quality and effort of H.264; yuv420p is what every player shows.
_H264 = {"crf": "22", "preset": "veryfast"}
_COLOURS = 96

Frames = Iterable[NDArray[np.uint8]]


def write_film(frames: Frames, path: Path, progress: Callable[[int], None] = lambda _: None) -> None:
    """Write frames as a film; the file appears when it is whole.

    Args:
        frames: (height, width, 3) each, all of one size, even numbers for MP4.
        path: Its ending says what it becomes.
        progress: Receives how many frames have been written.

    Raises:
        UsageError: the ending is another, or the extra `film` is not installed.
        OSError: the machine refuses.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise UsageError(f"--out: expected a file that ends with {', '.join(FORMATS)}, was {path.name}.")
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}{ending}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        counted = _counted(frames, progress)
        if ending == ".mp4":
            _write_mp4(counted, unfinished)
        else:
            _write_animation(counted, unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _counted(frames: Frames, progress: Callable[[int], None]) -> Iterator[NDArray[np.uint8]]:
    for i, frame in enumerate(frames, 1):
        yield frame
        progress(i)


def _write_mp4(frames: Iterator[NDArray[np.uint8]], path: Path) -> None:
    try:
        import av
    except ImportError as error:
        raise UsageError(f"av: expected the package, found none. Install it with: {REMEDY}") from error
    with av.open(str(path), "w") as container:
        stream: Any = None
        for pixels in frames:
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(FRAMES_PER_S), options=_H264)
                stream.height, stream.width = pixels.shape[:2]
                stream.pix_fmt = "yuv420p"
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())


def _write_animation(frames: Iterator[NDArray[np.uint8]], path: Path) -> None:
    is_gif = path.suffix == ".gif"
    pictures = (_few_colours(Image.fromarray(frame)) if is_gif else Image.fromarray(frame) for frame in frames)
    first = next(pictures)
    options: dict[str, Any] = {} if is_gif else {"quality": 60, "method": 2}
    first.save(path, save_all=True, append_images=pictures, duration=round(1000 / FRAMES_PER_S), loop=0, **options)


def _few_colours(picture: Image.Image) -> Image.Image:
    return picture.quantize(_COLOURS, dither=Image.Dither.NONE)
