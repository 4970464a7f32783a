"""The videos of a run inside its page: no file beside it is needed, and a still stands where nothing can move."""

import base64
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

from srl_jax.report import style
from srl_jax.report.content import Source
from srl_jax.report.data import Group
from srl_jax.report.markup import Html, element, text

SHOWN = 24  # videos that a page carries
NAME = re.compile(r"(?P<damage>.+)-seed(?P<seed>\d+)")


def films(sources: Sequence[Source], groups: Sequence[Group]) -> list[Html]:
    """A figure for every video, at most 24.

    Args:
        sources: the runs; where there are several, each video says of which it is.
        groups: methods, by which files are named.
    """
    shown = [(source, path) for source in sources for path in source.videos][:SHOWN]
    return [_film(path, groups, source.name if len(sources) > 1 else "") for source, path in shown]


def caption(stem: str, groups: Sequence[Group]) -> str:
    """What a video shows, by the name that `showcase.save_videos` gave its file, such as ``srl-leg_rm-seed3``."""
    for group in sorted(groups, key=lambda group: len(group.label), reverse=True):
        start = group.label.replace(" ", "-") + "-"
        found = NAME.fullmatch(stem.removeprefix(start)) if stem.startswith(start) else None
        if found:
            return f"{style.name(group)}, {found['damage'].replace('-', ':')}, seed {found['seed']}"
    return stem


def still(video: Path) -> bytes:
    """The first frame as JPEG; nothing where the file cannot be read."""
    import imageio_ffmpeg

    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(video), "-frames:v", "1"]
    return subprocess.run([*command, "-f", "image2pipe", "-c:v", "mjpeg", "-"], capture_output=True).stdout


def _film(path: Path, groups: Sequence[Group], run: str) -> Html:
    told = caption(path.stem, groups) + (f" ({run})" if run else "")
    frame, moving = (base64.b64encode(x).decode("ascii") for x in (still(path), path.read_bytes()))
    video = Html(
        f'<video controls muted loop playsinline preload="none" aria-label="{text(told)}" '
        f'poster="data:image/jpeg;base64,{frame}" src="data:video/mp4;base64,{moving}"></video>'
    )
    return element("figure", video, element("figcaption", told), class_="film")
