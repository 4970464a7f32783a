"""The house: rooms import downwards only, nothing imports itself in a circle, and files and functions fit a screen."""

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = (  # highest first; rooms of one line do not know each other
    ("run", "repertoire", "recover", "export", "play", "deploy", "__main__"),
    ("cli",),
    ("sweep",),
    ("job",),
    ("config",),
    ("demo",),
    ("pretrained", "show", "standard"),
    ("report", "atlas", "robot"),
    ("evaluate",),
    ("program",),
    ("ite",),
    ("agents",),
    ("bayes", "env"),
    ("portable",),
    ("types", "statistics", "distributions", "arrays", "blocks", "machine", "seam"),
)
WITHOUT_JAX = (  # so that `--help` answers at once, and devices are set up before jax starts
    *("__init__", "__main__", "run", "repertoire", "recover", "config", "machine", "ite.settings"),
    *("atlas.__main__", "cli.atlas", "cli.recover", "demo.__main__", "cli.demo", "portable", "arrays"),
    *("report.__main__", "cli.report", "job.command"),
    *("export", "play", "cli.export", "cli.play", "portable.graph", "pretrained", "atlas.stored", "env.interface"),
    *("deploy", "cli.deploy", "cli.deploy_story", "cli.deploy_options", "cli.simulate", "env.senses"),
    *("robot.outing", "robot.log", "robot.guard", "robot.dry", "robot.simulate.terminal", "robot.simulate.wire"),
    *("robot.simulate.child", "robot.simulate.__main__", "robot.lessons", "robot.odometer"),
    *("cli.deploy_learn", "job.course", "job.learning"),
    *("cli.main", "cli.run", "cli.repertoire", "cli.devices", "cli.ending", "cli.signals"),
    *(
        "cli.sweep",
        "cli.sweep_display",
        "cli.grid",
        "cli.pack",
        "sweep.manifest",
        "sweep.lease",
        "sweep.attempts",
        "sweep.cache",
    ),
    *("sweep.task", "sweep.local", "sweep.slurm", "sweep.status", "sweep.__main__"),
    *("job.plan", "job.files", "job.logs", "cli.left", "cli.doctor", "program.settings", "program.lanes"),
    *("agents.sweep", "agents.settings", "agents.rivals", "agents.registry"),
    *("env.settings", "env.anatomy", "env.damage_names", "standard", "standard.settings"),
)
JAX = {"jax", "jaxlib", "chex", "distrax", "flax", "optax", "orbax", "mujoco"}  # what is jax, imports it, or is large
LINES = {"srl_jax": 250, "experiments": 250, "tests": 300}  # of a file
LENGTH = 60  # lines of a function


class Import(NamedTuple):
    """One module that imports another."""

    by: str
    of: str
    at_once: bool  # when `by` is imported: neither inside a function nor for type checkers alone


def read(package: Path) -> dict[str, str]:
    """The source of every module of a package, by dotted name; a folder's `__init__` has the folder's name."""
    names = {path: path.relative_to(package.parent).with_suffix("").parts for path in sorted(package.rglob("*.py"))}
    return {".".join(parts[: -1 if parts[-1] == "__init__" else None]): p.read_text() for p, parts in names.items()}


def imports(sources: dict[str, str]) -> list[Import]:
    """Every import of every module; `from a.b import c` is of a.b, and of a.b.c where that is a module of `sources`.

    The list of public modules at the top is left out: a module that takes another from there does not mean the list.
    """
    found = []
    for by, text in sources.items():
        for node, at_once in _statements(ast.parse(text)):
            if isinstance(node, ast.Import):
                found += [Import(by, alias.name, at_once) for alias in node.names]
            else:
                assert node.module and not node.level, f"{by} imports by a relative name."
                whole = [f"{node.module}.{alias.name}" for alias in node.names]
                found += [Import(by, name, at_once) for name in whole if name in sources]
                if "." in node.module or not any(name in sources for name in whole):
                    found.append(Import(by, node.module, at_once))
    return found


def _statements(tree: ast.AST, at_once: bool = True) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, at_once
        later = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        typing = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        yield from _statements(node, at_once and not later and not typing)


def circle(sources: dict[str, str]) -> list[str]:
    """Modules that import one another in a circle, the first named twice; empty if there are none."""
    graph: dict[str, set[str]] = {name: set() for name in sources}
    for edge in imports(sources):
        if edge.of in sources:
            graph[edge.by].add(edge.of)
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def upward(sources: dict[str, str], package: str = "srl_jax") -> list[str]:
    """Imports of a room that is not below the importer's own; the package's list of public modules may import any."""
    inside = [edge for edge in imports(sources) if edge.of in sources and edge.by != package and edge.of != package]
    level = {name: number for number, rooms in enumerate(ROOMS) for name in rooms}
    room = lambda name: name.split(".")[-1 if name.endswith(".__main__") else 1]  # noqa: E731  a door, in its room
    homeless = [f"{name} lies in no room" for name in sources if name != package and room(name) not in level]
    arrows = [edge for edge in inside if room(edge.by) != room(edge.of)]
    return homeless or [f"{e.by} imports {e.of}" for e in arrows if level[room(e.by)] >= level[room(e.of)]]


def loaded(sources: dict[str, str], first: tuple[str, ...]) -> dict[str, list[str]]:
    """What importing these modules imports at once, of the package and of others: name -> the way to it."""
    edges: dict[str, list[str]] = {
        name: [name.rsplit(".", depth)[0] for depth in range(1, 1 + name.count("."))] for name in sources
    }
    for edge in imports(sources):
        if edge.at_once:
            edges[edge.by].append(edge.of)
    ways, waiting = {name: [name] for name in first}, list(first)
    while waiting:
        name = waiting.pop()
        for other in edges.get(name, []):
            if other not in ways:
                ways[other] = [*ways[name], other]
                waiting.append(other)
    return ways


def with_jax(sources: dict[str, str], names: tuple[str, ...]) -> list[str]:
    """The ways by which modules that must do without jax would import it."""
    ways = loaded(sources, names).values()
    return [" > ".join(way) for way in ways if way[-1].split(".")[0] in JAX]


def outside(sources: dict[str, str], room: str, library: str) -> list[str]:
    """Modules of a room that import a library which it should not know."""
    found = [edge for edge in imports(sources) if edge.of.split(".")[0] == library]
    return [edge.by for edge in found if edge.by.split(".")[1:2] == [room]]


def too_long(folder: Path, lines: int) -> list[str]:
    """Files of more lines."""
    counts = {path: len(path.read_text().splitlines()) for path in sorted(folder.rglob("*.py"))}
    return [f"{path.relative_to(folder)} has {count} lines" for path, count in counts.items() if count > lines]


def long_functions(sources: dict[str, str], lines: int) -> list[str]:
    """Functions of more lines."""
    nodes = [(name, node) for name, text in sources.items() for node in ast.walk(ast.parse(text))]
    own = [(name, node) for name, node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [f"{name}.{x.name}" for name, x in own if (x.end_lineno or 0) - x.lineno >= lines]


@pytest.fixture(scope="module")
def sources():
    return read(ROOT / "srl_jax")


def test_no_circle(sources):
    assert len(sources) > 50
    assert circle(sources) == []


def test_no_arrow_points_up(sources):
    assert upward(sources) == []


def test_settings_and_doors_do_without_jax(sources):
    named = tuple("srl_jax" if name == "__init__" else f"srl_jax.{name}" for name in WITHOUT_JAX)
    assert set(named) <= set(sources)
    assert with_jax(sources, named) == []


def test_the_robot_knows_no_command_line(sources):
    assert outside(sources, "env", "tyro") == []


@pytest.mark.parametrize("folder", LINES)
def test_files_are_short(folder):
    assert too_long(ROOT / folder, LINES[folder]) == []


def test_functions_fit_a_screen(sources):
    assert long_functions(sources, LENGTH) == []


# Each rule on a small house that breaks it.


def test_a_circle_is_found_wherever_it_hides():
    plain = {"p.a": "import p.b", "p.b": "from p import c", "p.c": ""}
    assert circle(plain) == []
    assert set(circle(plain | {"p.c": "def f():\n    from p import a"})) == {"p.a", "p.b", "p.c"}
    folder = {"p.d": "from p.d.e import f", "p.d.e": "from p.d import g", "p.d.g": ""}
    assert set(circle(folder)) == {"p.d", "p.d.e"}, "a folder's list is a module too"
    assert set(circle(plain | {"p.c": "if TYPE_CHECKING:\n    from p.b import X"})) == {"p.b", "p.c"}


def test_an_arrow_up_or_sideways_is_found():
    house = {
        "srl_jax": "from srl_jax import job",
        "srl_jax.job.run": "from srl_jax.env import robot",
        "srl_jax.env.robot": "",
        "srl_jax.bayes.value": "import numpy",
    }
    assert upward(house) == []
    up = house | {"srl_jax.env.robot": "def f():\n    from srl_jax.job.run import go"}
    assert upward(up) == ["srl_jax.env.robot imports srl_jax.job.run"]
    aside = house | {"srl_jax.bayes.value": "import srl_jax.env.robot"}
    assert upward(aside) == ["srl_jax.bayes.value imports srl_jax.env.robot"]
    assert upward(house | {"srl_jax.cellar": ""}) == ["srl_jax.cellar lies in no room"]


def test_jax_is_found_behind_other_modules_and_their_folders():
    house = {"p": "", "p.a": "from p.b import c", "p.b": "", "p.b.c": "def f():\n    import jax", "p.d": "import jax"}
    assert with_jax(house, ("p.a",)) == []
    assert with_jax(house | {"p.b.c": "if True:\n    import jax.numpy"}, ("p.a",)) == ["p.a > p.b.c > jax.numpy"]
    assert with_jax(house | {"p.b": "from optax import adam"}, ("p.a",)) == ["p.a > p.b > optax"]
    assert with_jax(house | {"p.a": "if TYPE_CHECKING:\n    from p import d"}, ("p.a",)) == []


def test_a_library_out_of_place_is_found():
    house = {"srl_jax.env.robot": "from tyro import cli", "srl_jax.cli.run": "import tyro"}
    assert outside(house, "env", "tyro") == ["srl_jax.env.robot"]


def test_length_is_found(tmp_path):
    (tmp_path / "long.py").write_text("x = 1\n" * 4)
    assert too_long(tmp_path, 4) == []
    assert too_long(tmp_path, 3) == ["long.py has 4 lines"]
    house = {"p.a": "def f():\n    x = 1\n    return x\n"}
    assert long_functions(house, 3) == []
    assert long_functions(house, 2) == ["p.a.f"]
