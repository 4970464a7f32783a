"""Physics side by side: C MuJoCo, MJX and the star stepper on the same damaged robots under the same random targets.

Every robot starts at the stance, and gets a new random position target for every joint at each control step of three
physics steps, twenty of them; then it starts anew. So all do the same work, however often they repeat it.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from experiments.contenders.measuring import Contender, Result, Runner, calibrated, cores, interleave

DAMAGES = ("healthy", "tibia_rf", "leg_rf", "leg_rm", "tibia_lm", "leg_lr")  # of the robots, in turn
PERIODS = 20  # control steps from a start
BLOCK = 64  # robots that MJX steps at once on a CPU: on our machines its fastest
REACH = 0.5  # standard deviation of the targets about the stance, rad
TITLES = {"c": "C MuJoCo", "mjx": "MJX", "ours": "ours"}
ON_CPU = {"JAX_PLATFORMS": "cpu"}
COLD = {"JAX_ENABLE_COMPILATION_CACHE": "false"}  # a first start, whatever has been compiled before


def names(robots: int) -> list[str]:
    """The damage of each robot."""
    return [DAMAGES[i % len(DAMAGES)] for i in range(robots)]


def targets(robots: int) -> np.ndarray:
    """Random position targets about the stance, rad: f64[PERIODS, robots, 18], the same for every contender."""
    from srl_jax.env.model import load_model, stance

    pose = stance(load_model())[7:]
    return pose + REACH * np.random.default_rng(0).standard_normal((robots, PERIODS, len(pose))).swapaxes(0, 1)


def in_c(robots: int, threads: int, least: float) -> Runner:
    """C MuJoCo by `mujoco.rollout`, the robots spread over threads."""
    from srl_jax.env.damage import damaged_model
    from srl_jax.env.hexapod import SUBSTEPS
    from srl_jax.env.model import load_model

    built = {name: damaged_model(name) for name in dict.fromkeys(names(robots))}
    models, plain, steps = [built[name] for name in names(robots)], load_model(), SUBSTEPS * PERIODS
    data = [mujoco.MjData(plain) for _ in range(threads)]
    mujoco.mj_resetDataKeyframe(plain, data[0], 0)
    first = np.zeros(mujoco.mj_stateSize(plain, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(plain, data[0], first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.tile(first, (robots, 1))
    control = np.repeat(targets(robots).swapaxes(0, 1), SUBSTEPS, axis=1)
    seen = np.zeros((robots, steps, len(first)))
    pool = rollout.Rollout(nthread=threads if threads > 1 else 0)  # 0: on the calling thread

    def run(count: int) -> None:
        for _ in range(count):
            pool.rollout(models, data, start, control, state=seen)

    count = calibrated(run, least)
    # Time, which is first, then the pose.
    return Runner(partial(run, count), count * robots * steps, {"position": seen[: len(DAMAGES), -1, 1:4].tolist()})


def in_jax(stepper: str, robots: int, devices: int, least: float) -> Runner:
    """MJX or the star stepper, the robots spread over devices."""
    from srl_jax.cli.devices import use_devices

    use_devices(str(devices), solves=stepper == "mjx")
    import jax
    import jax.numpy as jnp
    from jax.sharding import AxisType, NamedSharding, PartitionSpec

    from srl_jax.blocks import blocked_map
    from srl_jax.env import damage as damages
    from srl_jax.env.hexapod import SUBSTEPS
    from srl_jax.env.model import load_model, mjx, put_model, stance
    from srl_jax.env.physics import choose, simulate
    from srl_jax.env.star.stepper import State

    c_model, star = load_model(), choose(stepper)
    step = partial(simulate, star, put_model(c_model), mjx.make_data(c_model))
    block = BLOCK if star is None and jax.default_backend() == "cpu" else 0

    def period(rows: Any) -> State:
        return jax.vmap(lambda damage, state, control: step(damage, state, control, SUBSTEPS))(*rows)

    def all_periods(damage: Any, state: State, control: jax.Array) -> State:
        def once(state: State, now: jax.Array) -> tuple[State, None]:
            return blocked_map(period, (damage, state, now), block), None

        return jax.lax.scan(once, state, control)[0]

    mesh = jax.make_mesh((devices,), ("robots",), (AxisType.Auto,), devices=jax.devices()[:devices])
    rows, later = PartitionSpec("robots"), PartitionSpec(None, "robots")
    mapped = jax.shard_map(all_periods, mesh=mesh, in_specs=(rows, rows, later), out_specs=rows, check_vma=False)
    pose = jnp.tile(jnp.asarray(stance(c_model), jnp.float32), (robots, 1))
    start = State(pose, jnp.zeros((robots, c_model.nv)), jnp.zeros((robots, c_model.nv)))
    damage, start = jax.device_put((damages.stack(names(robots)), start), NamedSharding(mesh, rows))
    control = jax.device_put(jnp.asarray(targets(robots), jnp.float32), NamedSharding(mesh, later))
    compiled: Any = jax.jit(mapped).lower(damage, start, control).compile()

    def run(count: int) -> State:
        for _ in range(count):
            state = compiled(damage, start, control)
            jax.block_until_ready(state)
        return state

    count = calibrated(run, least)
    facts = {"device": jax.devices()[0].device_kind, "position": np.asarray(run(1).qpos[: len(DAMAGES), :3]).tolist()}
    return Runner(partial(run, count), count * robots * SUBSTEPS * PERIODS, facts)


def contenders(robots: int, least: float, wanted: Sequence[str]) -> list[Contender]:
    """Those of one number of robots: on one core, and on two where this process has two and there are two robots."""
    own, found = cores(), []
    for count in (1, 2)[: min(len(own), robots, 2)]:
        on, where = (tuple(own[:count]),), f"{count} core" + "s" * (count > 1)
        makers = {
            "c": partial(in_c, robots, count, least),
            "mjx": partial(in_jax, "mjx", robots, count, least),
            "ours": partial(in_jax, "star", robots, count, least),
        }
        found += [Contender(f"{TITLES[name]}, {where}", makers[name], on, ON_CPU) for name in makers if name in wanted]
    return found


def on_accelerator(robots: int, least: float, wanted: Sequence[str]) -> list[Contender]:
    """MJX and the star stepper on the first device of the default backend."""
    on, steppers = (tuple(cores()),), {"mjx": "mjx", "ours": "star"}
    frugal = {"XLA_PYTHON_CLIENT_PREALLOCATE": "false"}  # both are there at once
    return [
        Contender(TITLES[name], partial(in_jax, stepper, robots, 1, least), on, frugal)
        for name, stepper in steppers.items()
        if name in wanted
    ]


def accelerator() -> str:
    """The backend that jax chooses by itself, asked in another process; empty where that is the processor."""
    (said,) = interleave([Contender("backend", _backend, (tuple(cores()),))], 0, lambda said: None)
    backend = said.facts.get("backend", "cpu")
    return "" if backend == "cpu" else backend


def _backend() -> Runner:
    import jax

    return Runner(lambda: None, 0.0, {"backend": jax.default_backend()})


def side_by_side(
    batches: Sequence[int],
    rounds: int,
    least: float,
    wanted: Sequence[str],
    note: Callable[[str], None],
    accelerator: bool = False,
) -> dict[int, list[Result]]:
    """Every contender at every number of robots.

    Args:
        batches: numbers of robots.
        rounds: how often each is timed.
        least: seconds that a timed run takes at least, about.
        wanted: names of contenders.
        note: told what is under way.
        accelerator: on the default backend's first device, not on cores.

    Returns:
        Results by number of robots.
    """
    choose = on_accelerator if accelerator else contenders
    return {
        robots: interleave(choose(robots, least, wanted), rounds, lambda said, n=robots: note(f"{n} robots, {said}"))
        for robots in batches
    }


def rows(found: dict[int, list[Result]]) -> tuple[list[str], list[list[str]]]:
    """The table's titles and rows: steps per second of the median round with their spread, and what they are to ours.

    Ratios are of the contenders that use as much of the machine as the first of ours does.
    """
    titles = list(dict.fromkeys(result.name for results in found.values() for result in results))
    ours = next((title for title in titles if title.startswith("ours")), "ours")
    others = [title for title in titles if title != ours and title.partition(",")[2] == ours.partition(",")[2]]
    body = []
    for robots, results in found.items():
        by_name = {result.name: result for result in results}
        rate = {name: result.rate for name, result in by_name.items() if result.seconds}
        ratios = [f"{rate[ours] / rate[other]:.2f}" if {ours, other} <= set(rate) else "-" for other in others]
        body.append([f"{robots:,}", *(_cell(by_name.get(title)) for title in titles), *ratios])
    return ["robots", *titles, *(f"ours / {other}" for other in others)], body


def _cell(result: Result | None) -> str:
    if result is None:
        return "-"
    return "failed" if not result.seconds else f"{result.rate:,.0f} ± {result.spread:.0%}"


def per_watt(found: dict[int, list[Result]]) -> str:
    """Steps per second and watt, which are steps per joule, of every contender; empty where none could be read."""
    read = [(n, one.name, one.units / one.joules) for n, results in found.items() for one in results if one.joules]
    return "; ".join(f"{robots:,} robots {name} {value:,.0f}" for robots, name, value in read)
