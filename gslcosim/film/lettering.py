"""Words in pictures."""

from functools import cache
from typing import Any

from PIL import ImageDraw, ImageFont

from gslcosim.recording.colors import Rgb


def write(draw: ImageDraw.ImageDraw, place: tuple[float, float], text: str, color: Rgb, size_px: int) -> None:
    """Write a text whose upper left corner is at a place, in a size [pixels]."""
    draw.text(place, text, fill=color, font=_font(size_px))


@cache
def _font(size_px: int) -> Any:
    return ImageFont.load_default(size_px)
