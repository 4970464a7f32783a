"""Orbax checkpoints: the whole state of a run, and beside it the networks alone, which are small and often wanted.

Rows are stored as they lie on the devices of the run, with the lane of each; whoever reads them arranges them anew, so
a run may go on with another number of devices.
"""

import contextlib
import errno
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp

from srl_jax.job import absent
from srl_jax.program.lanes import Lane, moved
from srl_jax.program.state import LaneData, Program, TrainState, on_all, on_rows
from srl_jax.program.tally import Tally


class Networks(NamedTuple):
    """What one algorithm has learned."""

    trees: dict[str, Any]  # "actor" and "critic", leaves [n, ...]
    place: dict[int, int]  # index of a lane -> its row


@contextlib.contextmanager
def manager(directory: Path) -> Iterator[ocp.CheckpointManager]:
    """Writes in the background and atomically; keeps the newest checkpoint (a replay is large).

    Raises:
        OSError: the disk is full; what had been saved before is whole.
    """
    options = ocp.CheckpointManagerOptions(max_to_keep=1, enable_async_checkpointing=True, create=True)
    try:
        with ocp.CheckpointManager(directory.absolute(), options=options) as keeper:
            yield keeper
    except Exception as error:  # the storage below Orbax reports a full disk as a ValueError of its own
        if "RESOURCE_EXHAUSTED" in str(error):
            raise OSError(errno.ENOSPC, "No space left on device", str(directory)) from None
        raise


def save(
    keeper: ocp.CheckpointManager,
    program: Program,
    state: TrainState,
    lanes: LaneData,
    tally: Tally,
    about: dict[str, Any],
    *,
    last: bool = False,
) -> None:
    """Starts saving at the state's clock; the program may go on at once.

    What is saved is copied first, since the next chunk writes into the state's own buffers; after the `last` chunk
    nothing does, and the memory is spared. Replay rows that are not filled yet are left out. `about` is JSON and comes
    back with `restore`.
    """
    step = int(state.clock)
    payload = _payload(state, lanes, tally, _filled(state, step))
    small = {algo: {"actor": agent.actor, "critic": agent.critic} for algo, agent in state.agents.items()}
    if not last:
        payload, small = jax.jit(lambda tree: jax.tree.map(jnp.copy, tree))((payload, small))
    layout = program.layout
    stored = {
        "rows": [lane.index for lane in layout.rows],
        "lanes": {algo: [lane.index for lane in layout.of(algo)] for algo in layout.algos},
        "about": about,
    }
    items = ocp.args.Composite(
        state=ocp.args.StandardSave(payload),
        networks=ocp.args.StandardSave(small),
        layout=ocp.args.JsonSave(stored),
    )
    keeper.save(step, args=items)


def restore(
    keeper: ocp.CheckpointManager, program: Program, state: TrainState, lanes: LaneData, tally: Tally
) -> tuple[TrainState, LaneData, Tally, dict[str, Any]] | None:
    """The newest checkpoint on the program's devices, whatever devices it was saved from; None where there is none yet.

    Args:
        keeper: from `manager`.
        program: whose lanes are those of the checkpoint.
        state: at step 0; its replay is filled from the checkpoint.
        lanes: the rows.
        tally: any.

    Returns:
        The state, the rows with their healthy replay, the tally, and `about` as it was saved.

    Raises:
        ValueError: the checkpoint cannot be read.
    """
    step = keeper.latest_step()
    if step is None:
        return None
    stored = _read(keeper, step, layout=ocp.args.JsonRestore())["layout"]
    filled = _filled(state, step)
    now = _payload(state, lanes, tally, filled)
    wanted = now | {
        "by_algo": {algo: _shapes(tree, len(stored["lanes"][algo])) for algo, tree in now["by_algo"].items()},
        "by_row": _shapes(now["by_row"], len(stored["rows"])),
        "shared": _shapes(now["shared"], None),
    }
    found = _read(keeper, step, state=ocp.args.StandardRestore(wanted))["state"]
    by_row = _arranged(program, found["by_row"], stored["rows"], program.layout.rows)
    own = {
        algo: _arranged(program, tree, stored["lanes"][algo], program.layout.of(algo))
        for algo, tree in found["by_algo"].items()
    }
    fill = jax.jit(lambda rows, new: rows.at[:, : new.shape[1]].set(new), donate_argnums=0)
    clock, updates = on_all(program, (found["shared"]["clock"], found["shared"]["updates"]))
    restored = TrainState(
        clock=clock,
        agents={algo: tree["agent"] for algo, tree in own.items()},
        replay={a: jax.tree.map(fill, x, own[a]["replay"]) for a, x in state.replay.items()},
        world=absent.restored(state.world, by_row["world"]),
        alive=by_row["alive"],
    )
    prior = {algo: own[algo]["prior"] for algo in lanes.prior}
    counted = Tally(**by_row["tally"], updates=updates, losses={algo: own[algo]["losses"] for algo in tally.losses})
    return restored, lanes._replace(prior=prior), counted, stored["about"]


def newest(directory: Path) -> int:
    """The environment step of the newest checkpoint in a directory of them; 0 where there is none."""
    names = [path.name for path in directory.iterdir()] if directory.is_dir() else []
    return max((int(name) for name in names if name.isdigit()), default=0)


def learned(run: Path, lanes: Sequence[Lane]) -> dict[str, Networks]:
    """What every algorithm of a finished run has learned, be its lanes trained at once or in waves.

    Args:
        run: its directory.
        lanes: all of the run's.

    Raises:
        ValueError: a lane has no checkpoint yet, or it cannot be read.
    """
    folders = sorted(run.glob("wave-*"), key=lambda path: int(path.name.rpartition("-")[2])) or [run]
    found: dict[str, Networks] = {}
    for wave in (networks(folder / "checkpoints") for folder in folders):
        for algo, new in wave.items():
            found[algo] = _joined(found[algo], new) if algo in found else new
    missing = [lane.index for lane in lanes if lane.algo not in found or lane.index not in found[lane.algo].place]
    if missing:
        raise ValueError(f"{run} has not trained lane {missing[0]} yet: go on with it by --resume {run}.")
    return found


def _joined(old: Networks, new: Networks) -> Networks:
    before = next((len(leaf) for leaf in jax.tree.leaves(old.trees)), 0)
    trees = jax.tree.map(lambda *parts: jnp.concatenate(parts), old.trees, new.trees)
    return Networks(trees, old.place | {lane: before + row for lane, row in new.place.items()})


def networks(directory: Path) -> dict[str, Networks]:
    """What every algorithm has learned, from the newest checkpoint in a directory of them.

    Raises:
        ValueError: there is no checkpoint, or it cannot be read.
    """
    if not directory.is_dir():
        raise ValueError(f"{directory} is not a directory of checkpoints: a finished run has one.")
    with manager(directory) as keeper:
        step = keeper.latest_step()
        if step is None:
            raise ValueError(f"{directory} holds no complete checkpoint: a finished run has one.")
        wanted = ocp.args.StandardRestore(_on_one_device(directory, step))
        found = _read(keeper, step, networks=wanted, layout=ocp.args.JsonRestore())
    places = {algo: _places(rows) for algo, rows in found["layout"]["lanes"].items()}
    return {algo: Networks(trees, places[algo]) for algo, trees in found["networks"].items()}


def _places(rows: Sequence[int]) -> dict[int, int]:
    return {lane: row for row, lane in reversed(list(enumerate(rows)))}


def _payload(state: TrainState, lanes: LaneData, tally: Tally, filled: int) -> dict[str, Any]:
    """What is stored, by the kind of rows that its leaves have."""
    parts: dict[str, dict[str, Any]] = {algo: {"agent": agent} for algo, agent in state.agents.items()}
    for algo, replay in state.replay.items():
        if filled < replay.facts.shape[1]:  # a slice is a copy
            replay = replay._replace(moves=replay.moves[:, :filled], facts=replay.facts[:, :filled])
        parts[algo]["replay"] = replay
    for name, found in (("prior", lanes.prior), ("losses", tally.losses)):
        for algo, value in found.items():
            parts[algo][name] = value
    sums = {name: getattr(tally, name) for name in ("episodes", "totals", "steps", "rates")}
    return {
        "by_algo": parts,
        "by_row": {"world": absent.stored(state.world), "alive": state.alive, "tally": sums},
        "shared": {"clock": state.clock, "updates": tally.updates},
    }


def _shapes(tree: Any, rows: int | None) -> Any:
    """What a stored tree looks like on one device, with so many rows (None: leaves have no rows)."""
    device = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    shape = lambda x: x.shape if rows is None else (rows, *x.shape[1:])  # noqa: E731
    return jax.tree.map(lambda x: jax.ShapeDtypeStruct(shape(x), x.dtype, sharding=device), tree)


def _arranged(program: Program, tree: Any, old: Sequence[int], new: Sequence[Any]) -> Any:
    """Rows in the order of another layout, on its devices."""
    order = moved(old, new)
    same = len(order) == len(old) and np.array_equal(order, np.arange(len(old)))
    return jax.tree.map(lambda x: on_rows(program, np.asarray(x) if same else np.asarray(x)[order]), tree)


def _on_one_device(directory: Path, step: int) -> Any:
    """What the networks of a checkpoint look like on this machine, whatever devices the run had."""
    device = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    with ocp.StandardCheckpointer() as reader:
        stored = reader.metadata(directory.absolute() / str(step) / "networks").item_metadata
    return jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=device), dict(stored.tree))


def _filled(state: TrainState, step: int) -> int:
    """Vector steps of a replay worth keeping; at least one, since an empty array cannot be stored."""
    for replay in state.replay.values():
        steps, environments = replay.facts.shape[1:3]
        return min(max(step // environments, 1), steps)
    return 1


def _read(keeper: ocp.CheckpointManager, step: int, **items: Any) -> Any:
    try:
        return keeper.restore(step, args=ocp.args.Composite(**items))
    except Exception as error:  # Orbax and its storage raise many kinds for a damaged file
        raise ValueError(
            f"checkpoint {step} in {keeper.directory} cannot be read ({type(error).__name__}); "
            "remove its folder to start again from the beginning, or restore it from a copy."
        ) from error
