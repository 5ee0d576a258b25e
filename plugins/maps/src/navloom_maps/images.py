"""Reads the image of a ROS map like map_server: PGM (P2, P5) directly, PNG through Pillow."""

from __future__ import annotations

import io
import re
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from navloom.geometry.grid import MAX_CELLS
from navloom.inputs import IMAGE_MB
from navloom.worlds import WorldError, read_bytes
from numpy.typing import NDArray

__all__ = ["Shades", "read_image"]

_HEADER = 65536
"""Largest header of a PGM with its comments, bytes."""
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Number of channels by colour type of a PNG: grey, RGB, palette, grey and alpha, RGB and alpha."""
_INFLATED = 1032
"""Largest number of bytes that one byte of deflate can expand to."""
_STRIP = 1 << 20
"""Number of pixels that are converted at once."""
_PGM = re.compile(
    rb"P([25])(?:\s|#[^\n\r]*+[\n\r])++(\d{1,9})(?:\s|#[^\n\r]*+[\n\r])++(\d{1,9})(?:\s|#[^\n\r]*+[\n\r])++(\d{1,9})"
)
_SPACE = re.compile(rb"\s")
_FILLER = re.compile(rb"\s|#[^\n]*+\n")
"""What some programs write, against the format, before the pixels: CR LF, empty lines, comments."""


@dataclass(frozen=True, eq=False)
class Shades:
    """Brightness of an image's pixels.

    Attributes:
        levels: (rows, cols) unsigned integers, row 0 at the top; `top` is white.
        top: Level of white.
        opaque: (rows, cols) bool, or None if the image has no transparency.
        with_alpha: (rows, cols) sum of the colours' brightness and the opacity, `top_with_alpha` is opaque white;
            None if the image has no transparency.
        top_with_alpha: See `with_alpha`.
    """

    levels: NDArray[np.integer]
    top: int
    opaque: NDArray[np.bool_] | None = None
    with_alpha: NDArray[np.integer] | None = None
    top_with_alpha: int = 0


def read_image(path: Path) -> Shades:
    """The pixels of a PGM or PNG file.

    Raises:
        WorldError: The file is missing, of another format, damaged, truncated, or larger than a map can be.
    """
    content = read_bytes(path, IMAGE_MB)
    if content[:2] in (b"P2", b"P5"):
        return _pgm(content, path)
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        return _png(content, path)
    raise WorldError(f"{path}: starts with {content[:8]!r}, expected a PGM (P2 or P5) or PNG image")


def _check_size(path: Path, width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > MAX_CELLS:
        raise WorldError(f"{path}: {width} x {height} pixels, expected 1 to {MAX_CELLS} pixels")


def _pgm(content: bytes, path: Path) -> Shades:
    header = _PGM.match(content[:_HEADER])
    if header is None:
        raise WorldError(f"{path}: PGM header {content[:24]!r}, expected P2 or P5, width, height and highest value")
    width, height, top = int(header[2]), int(header[3]), int(header[4])
    _check_size(path, width, height)
    if not 1 <= top <= 65535:
        raise WorldError(f"{path}: highest value {top} in the PGM header, expected 1 to 65535")
    read = _plain_values if header[1] == b"2" else _raw_values
    values = read(content, header.end(), width * height, top, path)
    if values.max() > top:
        raise WorldError(f"{path}: a pixel of {values.max()}, expected at most the {top} of the PGM header")
    return Shades(values.reshape(height, width), top)


def _plain_values(content: bytes, start: int, count: int, top: int, path: Path) -> NDArray[np.integer]:
    """The numbers of a P2 image, parsed in pieces, since parsing at once takes eight times the file's size."""
    body = content[start:] if b"#" not in content[start:] else re.sub(rb"#[^\n\r]*", b"", content[start:])
    wrong = re.search(rb"[^0-9\s]|[0-9]{7}", body)
    if wrong is not None:
        raise WorldError(f"{path}: {body[wrong.start() : wrong.start() + 8]!r} among the pixels, expected numbers")
    pieces: list[NDArray[np.integer]] = []
    left, at = count, 0
    while left > 0 and at < len(body):
        gap = _SPACE.search(body, at + _STRIP)
        end = gap.start() if gap is not None else len(body)
        piece = body[at:end].strip()
        values = np.fromstring(piece.decode("ascii"), dtype=np.int64, sep=" ") if piece else np.zeros(0, np.int64)
        pieces.append(values[:left].astype(np.int32))
        left, at = left - values.size, end
    if left > 0:
        raise WorldError(f"{path}: truncated: {count - left} pixels, expected {count}; copy the file again")
    if left < 0 or body[at:].strip():
        raise WorldError(f"{path}: more than the {count} pixels of the PGM header; save the image again")
    return np.concatenate(pieces)


def _raw_values(content: bytes, start: int, count: int, top: int, path: Path) -> NDArray[np.integer]:
    kind = np.dtype(np.uint8) if top < 256 else np.dtype(">u2")
    # One white space separates the header from the pixels.
    begin, size = start + 1, count * kind.itemsize
    surplus = len(content) - begin - size
    if surplus < 0:
        raise WorldError(
            f"{path}: truncated: {max(size + surplus, 0)} bytes of pixels, expected {size}; copy the file again"
        )
    if surplus:
        begin += _header_surplus(content, begin, size, path)
    return np.frombuffer(content, dtype=kind, count=count, offset=begin).astype(kind.newbyteorder("="))


def _header_surplus(content: bytes, begin: int, size: int, path: Path) -> int:
    """How many of a file's surplus bytes precede the pixels. The others must be white space at its end.

    Args:
        content: The file.
        begin: Offset of the pixels if the header is as the format demands.
        size: Length of the pixels, bytes.
        path: Name of the file in errors.
    """
    surplus, trailing = len(content) - begin - size, len(content) - len(content.rstrip())
    # Pixels can be any bytes, white space too: the length of the file must leave one possibility.
    fits = [0] if surplus <= trailing else []
    end = begin
    while filler := _FILLER.match(content, end, begin + min(surplus, _HEADER)):
        end = filler.end()
        if begin + surplus - end <= trailing:
            fits.append(end - begin)
    if len(fits) != 1:
        raise WorldError(
            f"{path}: {surplus} bytes more than the {size} of its pixels, and it is uncertain where the pixels begin;"
            " save the image again, as PNG or as PGM without a comment after the highest value"
        )
    return fits[0]


def _png(content: bytes, path: Path) -> Shades:
    from PIL import Image

    if len(content) >= 26:  # before Pillow, which has its own bound and allocates all pixels first
        _check_png_head(content, path)
    try:
        with warnings.catch_warnings():
            # Pillow's own warning about large images; the check below is stricter.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(content), formats=["PNG"])
        _check_size(path, *image.size)
        image.load()
        if image.mode.startswith("I"):
            return Shades(np.clip(np.asarray(image), 0, 65535).astype(np.uint16), 65535)
        return _colours(image)
    except WorldError:
        raise
    except Exception as error:
        # Pillow does not document what it raises on damaged files: OSError, SyntaxError, ValueError, struct.error, ...
        raise WorldError(f"{path}: damaged PNG: {error}; copy the file again") from error


def _check_png_head(content: bytes, path: Path) -> None:
    """Refuse a PNG whose header has an invalid size, or more pixels than its bytes can hold."""
    width, height, depth, kind = struct.unpack_from(">IIBB", content, 16)
    _check_size(path, width, height)
    size = width * height * depth * _CHANNELS.get(kind, 1) // 8
    if size > _INFLATED * len(content):
        raise WorldError(
            f"{path}: truncated: {len(content)} bytes for {width} x {height} pixels, expected at least"
            f" {size // _INFLATED}; copy the file again"
        )


def _colours(image: Any) -> Shades:
    """The sum of the colours of a loaded image, computed in strips of rows: at once it would take 14 bytes a pixel."""
    is_clear = "A" in image.getbands() or "transparency" in image.info
    width, height = image.size
    colours = np.empty((height, width), dtype=np.uint16)
    alpha = np.empty((height, width), dtype=np.uint8) if is_clear else None
    rows = max(1, _STRIP // width)
    for top in range(0, height, rows):
        end = min(top + rows, height)
        strip = image.crop((0, top, width, end)).convert("RGBA" if is_clear else "RGB")
        pixels = np.asarray(strip)
        colours[top:end] = pixels[..., :3].sum(axis=2, dtype=np.uint16)
        if alpha is not None:
            alpha[top:end] = pixels[..., 3]
    if alpha is None:
        return Shades(colours, 3 * 255)
    return Shades(colours, 3 * 255, alpha == 255, colours + alpha, 4 * 255)
