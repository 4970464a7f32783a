"""What stands in a page that was written: its payload, and the sources of its template."""

import base64
import gzip
import hashlib
import json
import re
from pathlib import Path
from typing import Any

from srl_jax.demo.page import TEMPLATE


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
