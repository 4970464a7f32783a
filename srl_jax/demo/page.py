"""One file that opens from anywhere: the template with policies in it."""

import base64
import gzip
import json
from pathlib import Path
from typing import Any

TEMPLATE = Path(__file__).with_name("template.html")
PLACE = "@@PAYLOAD@@"


def write(out: Path, payload: dict[str, Any]) -> int:
    """Writes the page, all of it or nothing; its size in bytes."""
    packed = gzip.compress(json.dumps(payload, separators=(",", ":")).encode(), 9, mtime=0)
    before, after = TEMPLATE.read_text().split(PLACE, 1)
    out.parent.mkdir(parents=True, exist_ok=True)
    partial = out.with_suffix(".partial")
    partial.write_text(before + base64.b64encode(packed).decode("ascii") + after)
    partial.replace(out)
    return out.stat().st_size
