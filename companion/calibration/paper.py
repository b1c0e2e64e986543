"""Sheets of paper: a board in the middle of one, as PNG or PDF that print at their true size."""

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import MM_PER_INCH, Board, draw_board
from companion.errors import LandslopeError

PAPERS = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "a2": (420.0, 594.0), "letter": (215.9, 279.4)}
"""Name -> width and height in mm, upright."""

POINTS_PER_INCH = 72.0


def on_paper(board: Board, dpi: float, paper: str) -> NDArray[np.uint8]:
    """The board in the middle of a sheet, upright or across; LandslopeError where it does not fit."""
    drawn = draw_board(board, dpi)
    px_per_mm = dpi / MM_PER_INCH
    short, long = PAPERS[paper]
    for width_mm, height_mm in ((long, short), (short, long)):
        sheet = np.full((round(height_mm * px_per_mm), round(width_mm * px_per_mm)), 255, np.uint8)
        top, left = (sheet.shape[0] - drawn.shape[0]) // 2, (sheet.shape[1] - drawn.shape[1]) // 2
        if top >= 0 and left >= 0:
            sheet[top : top + drawn.shape[0], left : left + drawn.shape[1]] = drawn
            return sheet
    needed = " x ".join(f"{side / px_per_mm:.0f}" for side in reversed(drawn.shape))
    raise LandslopeError(
        f"the board with its margin is {needed} mm, {paper.upper()} {long:.0f} x {short:.0f}: choose smaller squares, "
        f"fewer of them, or --paper {' or '.join(PAPERS)}"
    )


def save_board(path: Path, page: NDArray[np.uint8], dpi: float) -> None:
    """Write a PNG or a PDF, by the name's ending, that says its size: printed at 100 % it is the one asked for."""
    coders = {".png": _png, ".pdf": _pdf}
    if path.suffix.lower() not in coders:
        raise LandslopeError(f"{path}: a board is written as {' or '.join(coders)}: name it so")
    try:
        path.write_bytes(coders[path.suffix.lower()](page, dpi))
    except OSError as error:
        raise LandslopeError(f"{path}: cannot be written: {error.strerror}") from error


def _png(page: NDArray[np.uint8], dpi: float) -> bytes:
    """Grey, 8 bits, with its resolution (PNG 1.2: IHDR, pHYs, IDAT, IEND)."""
    height, width = page.shape
    per_metre = round(dpi / MM_PER_INCH * 1000)
    lines = np.concatenate((np.zeros((height, 1), np.uint8), page), axis=1)  # each line without a filter
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


def _pdf(page: NDArray[np.uint8], dpi: float) -> bytes:
    """One page as large as the sheet, filled by one grey image (PDF 1.4)."""
    height, width = page.shape
    across, down = (side / dpi * POINTS_PER_INCH for side in (width, height))
    image = zlib.compress(page.tobytes(), 9)
    draw = f"q {across:.3f} 0 0 {down:.3f} 0 0 cm /Board Do Q".encode()
    objects = (
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {across:.3f} {down:.3f}] /Contents 4 0 R "
        "/Resources << /XObject << /Board 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%b\nendstream" % (len(draw), draw),
        b"<< /Type /XObject /Subtype /Image /Width %d /Height %d /ColorSpace /DeviceGray /BitsPerComponent 8 "
        b"/Filter /FlateDecode /Length %d >>\nstream\n%b\nendstream" % (width, height, len(image), image),
    )
    out, places = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
    for number, content in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%b\nendobj\n" % (number, content)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    count = len(objects) + 1
    return out + (
        b"xref\n0 %d\n0000000000 65535 f \n%btrailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n"
        % (count, table, count, len(out))
    )
