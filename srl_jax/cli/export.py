"""The verb ``export``: policies of a run or an atlas, in files that need neither the package nor jax."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from srl_jax import portable
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.cli.run import quiet
from srl_jax.env import damage_names
from srl_jax.portable import Policy, graph

PROGRAM = "srl-jax export"
KINDS = (".npz", ".json", ".onnx")


@dataclass(frozen=True)
class Arguments:
    """Write policies that a run or an atlas has learned, each with what one must know to use it elsewhere."""

    source: Annotated[str, tyro.conf.Positional] = ""
    """Directory of a finished run, or file of an atlas; none: the atlas that ships with the package."""
    algo: tuple[str, ...] = ()
    """Of a run, only these algorithms; none: all that learn a network."""
    seed: int | None = None
    """Of a run, only the lanes of this seed."""
    damage: tuple[str, ...] = ()
    """Only what was learned for these damages, such as leg_rm leg_lf."""
    format: Literal["npz", "json", "onnx"] = "npz"
    """npz: arrays, one file of all; json: the same for people and other languages; onnx: a graph in a file for each
    (pip install 'srl-jax[onnx]')."""
    precision: Literal["full", "half", "coarse"] = "full"
    """half: weights at half precision; coarse: in multiples of 1/256 as well, two thirds of the size."""
    out: str = ""
    """The file, or a directory; empty: policies.FORMAT here, and for onnx the directory policies."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line and writes the files; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    policies = [portable.rounded(policy, arguments.precision) for policy in _chosen(arguments)]
    paths = _paths(policies, arguments.out, arguments.format)
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    if arguments.format == "onnx":
        for path, policy in zip(paths, policies, strict=True):
            graph.save(path, policy)
    else:
        portable.save(paths[0], policies, half=arguments.precision != "full")
    for policy in policies:
        print(described(policy))
    where = paths[0] if len(paths) == 1 else paths[0].parent
    print(f"{where}: {len(policies)} policies, {sum(path.stat().st_size for path in paths) / 1e3:.1f} kB.")
    return 0


def described(policy: Policy) -> str:
    """A line on what a policy is for."""
    method, task, damage, seed, kind = (policy.about[name] for name in ("method", "task", "damage", "seed", "kind"))
    return f"{method} for {task}, {damage}, seed {seed}: reads {policy.observation_size} numbers ({kind})"


def _chosen(arguments: Arguments) -> list[Policy]:
    source = Path(arguments.source)
    if arguments.source and source.is_dir():
        use_devices("1", solves=False)
        quiet()
        from srl_jax.job import export  # jax starts here

        return export.from_run(source, seed=arguments.seed, algos=arguments.algo, damages=arguments.damage)
    from srl_jax.atlas import stored

    for name, value in (("algo", arguments.algo), ("seed", arguments.seed)):
        if value not in ((), None):
            raise ValueError(f"{name} is {value}: an atlas has one policy for each damage, chosen by damage alone.")
    own = list(stored.policies(stored.read(arguments.source)).values())
    damages = tuple(map(damage_names.canonical, arguments.damage))
    return portable.pick(own, damages, arguments.source or "the atlas that ships")


def _paths(policies: Sequence[Policy], out: str, kind: str) -> list[Path]:
    """The one file of all policies, or one for each where a file has room for one.

    Raises:
        ValueError: `out` ends as another kind's files do, or is one file for several graphs.
    """
    path = Path(out or ("policies" if kind == "onnx" else f"policies.{kind}"))
    suffix = "" if path.is_dir() else path.suffix
    if suffix in KINDS and suffix != f".{kind}":
        raise ValueError(f"out is {path}: files of format {kind} end in .{kind}.")
    if kind != "onnx":
        return [path if suffix else path / f"policies.{kind}"]
    if not suffix:
        return [path / f"{_file_name(policy)}.onnx" for policy in policies]
    if len(policies) > 1:
        raise ValueError(
            f"out is {path}, one file: an .onnx holds one policy, and there are {len(policies)}; give a directory, or "
            "choose by --algo, --seed and --damage."
        )
    return [path]


def _file_name(policy: Policy) -> str:
    words = [str(policy.about[name]) for name in ("method", "task", "damage")]
    return "-".join(word.replace(" ", "-").replace(":", "-") for word in (*words, f"seed{policy.about['seed']}"))
