"""Saved images as a page takes them in."""

from base64 import b64encode
from io import BytesIO
from pathlib import Path

_COLOURS = 256  # of a palette: as many as a figure of lines and letters has, at a third of the bytes


def data_address(path: Path) -> str:
    """The image in a file as an address that holds it; a still one with a palette, which takes a third of the room."""
    return f"data:image/{path.suffix[1:]};base64,{b64encode(_smaller(path.read_bytes(), path.suffix)).decode()}"


def _smaller(content: bytes, suffix: str) -> bytes:
    """The image in `content` with a palette; as it is where that is no smaller."""
    if suffix != ".png":
        return content
    from PIL import Image

    packed = BytesIO()
    with Image.open(BytesIO(content)) as image:
        image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(packed, "PNG", optimize=True)
    return min(content, packed.getvalue(), key=len)
