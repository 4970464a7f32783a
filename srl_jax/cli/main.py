"""The one command, ``srl-jax VERB``: which verbs there are, and where each lies.

Only the verb that is asked for is imported, so that the list answers at once.
"""

import sys
from importlib import import_module

from srl_jax.cli.ending import leave

VERBS = {
    "run": ("train on damaged robots: every seed and every damage in one program", "srl_jax.cli.run:main"),
    "repertoire": ("fill a map of gaits by MAP-Elites, before any damage", "srl_jax.cli.repertoire:main"),
    "atlas": ("train a policy for every damage before it happens, and judge all under all", "srl_jax.cli.atlas:main"),
    "recover": ("one robot walks, is damaged in mid-stride, finds out and walks on", "srl_jax.cli.recover:main"),
    "demo": ("one page in which a visitor cuts off a leg, with your policies", "srl_jax.cli.demo:main"),
    "report": ("the page of a run made anew, or of several runs side by side", "srl_jax.cli.report:main"),
    "export": ("policies of a run or an atlas to take home: .npz, .json, .onnx", "srl_jax.cli.export:main"),
    "play": ("one policy on a robot that is damaged in mid-stride, as a video or live", "srl_jax.cli.play:main"),
    "deploy": ("one policy on the robot itself, or on a simulated bus", "srl_jax.cli.deploy:main"),
    "sweep": ("many lanes as packs, on one machine, a Slurm cluster or Ray", "srl_jax.cli.sweep:main"),
    "doctor": (
        "what this machine has, how fast it is, how long a run takes, what to change",
        "srl_jax.cli.doctor:main",
    ),
}  # name: (what it does, the function that is given its arguments)


def main(argv: list[str] | None = None) -> None:
    """Hands the arguments after the verb to it; lists the verbs without one. Exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    verb, *rest = argv or ["--help"]
    if verb in ("-h", "--help"):
        print(overview())
        return 0
    if verb not in VERBS:
        raise ValueError(f"srl-jax has no verb {verb!r}: choose from {', '.join(VERBS)}.")
    module, function = VERBS[verb][1].split(":")
    getattr(import_module(module), function)(rest)
    return 0


def overview() -> str:
    """The verbs, with a sentence each."""
    width = max(map(len, VERBS))
    lines = [f"  {name:<{width}}  {sentence}" for name, (sentence, _) in VERBS.items()]
    return "\n".join(["usage: srl-jax VERB [OPTIONS]", "", *lines, "", "srl-jax VERB --help lists a verb's options."])
