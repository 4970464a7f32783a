"""One file that opens from anywhere: the template with policies in it."""

import base64
import gzip
import hashlib
import json
import re
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


def read(path: Path) -> dict[str, Any]:
    """What a page carries."""
    found = re.search(r'id="payload">([^<]*)<', path.read_text())
    assert found
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


def made_of(path: Path = TEMPLATE) -> str:
    """The fingerprint of the sources that the template, or a page, was built from."""
    found = re.search(r"<!-- sources ([0-9a-f]{64}) -->", path.read_text()[:1000])
    assert found
    return found[1]


def fingerprint(web: Path) -> str:
    """The same of a folder of sources, as its `build.mjs` reckons it."""
    digest = hashlib.sha256()
    names = [*sorted(f"src/{path.name}" for path in (web / "src").iterdir()), "build.mjs", "package.json"]
    for name in names:
        digest.update(name.encode() + b"\0" + (web / name).read_bytes() + b"\0")
    return digest.hexdigest()
