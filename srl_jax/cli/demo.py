"""The verb ``demo``: one page, opened from anywhere, in which a visitor cuts off a leg."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.cli.run import quiet
from srl_jax.env.anatomy import PHANTOMX

if TYPE_CHECKING:
    from srl_jax.atlas.file import Atlas
    from srl_jax.portable import Policy

PROGRAM = "srl-jax demo"


@dataclass(frozen=True)
class Arguments:
    """Write one self-contained page: MuJoCo in the browser, your policies in it, and a visitor who breaks the robot."""

    sources: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Directories of finished runs, and files of atlases; none: the atlas that ships with the package."""
    out: str = "demo.html"
    """The page."""
    damages: str = "losses21+joints"
    """Of an atlas, for which damages the page gets policies: each is 15 kB and a robot more to simulate while the
    posterior is shown. Names and sets as --damage of a run; what the atlas has of them."""
    seed: int = 0
    """Whose lanes are taken from runs."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and writes the page; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    use_devices("1", solves=False)
    quiet()

    from srl_jax.demo import page  # jax starts here

    out = Path(arguments.out)
    if out.is_dir():
        raise ValueError(f"out is {out}, a directory: give the file that the page is to be, such as {out}/demo.html.")
    size = page.write(out, assembled(arguments))
    print(f"{out}: {size / 1e6:.1f} MB. Open it in a browser.")
    return 0


def assembled(arguments: Arguments) -> dict[str, Any]:
    """What the page is to carry.

    Raises:
        ValueError: a source is neither a finished run nor an atlas, or two do not fit on one page.
    """
    from srl_jax.atlas.stored import policies as of_atlas
    from srl_jax.demo import payload
    from srl_jax.job import export

    shown, known, named, clocks = [], None, [], {}
    for source in arguments.sources or ("",):
        if Path(source).is_dir() and source:
            policies = export.from_run(Path(source), seed=arguments.seed)
            about = policies[0].about
            if about["robot"] != PHANTOMX.name:
                raise ValueError(f"{source} has robot={about['robot']}: the page's robot is the {PHANTOMX.name}.")
            if about["history"]:
                raise ValueError(f"{source} has env.history={about['history']}: the page's robot keeps none, give 0.")
            made = f"Policies of a run of {about['steps']:,} environment steps a lane, seed {arguments.seed}."
            shown.append(payload.of_run(policies, f"{made} {_checked(policies)}"))
            named += [own.about["damage"] for own in policies]
            clocks[source] = about["clock_hz"]
            continue
        if known:
            raise ValueError(f"sources has two atlases, the second {source}: a page has room for one.")
        atlas, names = _atlas(source, arguments.damages)
        own = of_atlas(atlas)
        policies = [own[name] for name in names]
        made = f"Made by {atlas.about['command']}."
        shown.append(
            payload.of_atlas(dict(zip(names, policies, strict=True)), f"{made} {_checked(policies, own['healthy'])}")
        )
        known, clocks[source or "the atlas that ships"] = payload.mind(atlas, names), atlas.about["clock_hz"]
        named += names
    if len({round(clock, 6) for clock in clocks.values()}) > 1:
        each = ", ".join(f"{clock:.4g} Hz in {name}" for name, clock in clocks.items())
        raise ValueError(f"sources differ in the clock that policies see ({each}): make a page of each.")
    robot = payload.robot(next(iter(clocks.values())), payload.reachable(named))
    return robot | {"sources": shown} | ({"atlas": known} if known else {})


def _checked(policies: "list[Policy]", before: "Policy | None" = None) -> str:
    from srl_jax.demo import check

    said = check.said(policies, before)
    print(said, flush=True)
    return said


def _atlas(source: str, wanted: str) -> "tuple[Atlas, list[str]]":
    from srl_jax.atlas import file
    from srl_jax.env.damage_names import HEALTHY, parse_names

    atlas = file.load(source)
    if atlas.about["task"] != "x":
        raise ValueError(f"{source} is an atlas for {atlas.about['task']}: the page shows atlases for x.")
    asked = parse_names(wanted, atlas.about["task"])
    names = [HEALTHY, *(name for name in asked if name in atlas.trained_for and name != HEALTHY)]
    if len(names) == 1:
        raise ValueError(f"damages is {wanted!r}: the atlas has policies for {', '.join(atlas.trained_for)}.")
    return atlas, names
