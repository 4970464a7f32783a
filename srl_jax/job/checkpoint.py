"""Orbax checkpoints: the whole state of a run, and beside it the networks alone, which are small and often wanted."""

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import orbax.checkpoint as ocp

from srl_jax.program.replay import Replay
from srl_jax.program.state import LaneData, Tally, TrainState


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
    keeper: ocp.CheckpointManager, state: TrainState, lanes: LaneData, tally: Tally, *, last: bool = False
) -> None:
    """Starts saving at the state's clock; the program may go on at once.

    What is saved is copied first, since the next chunk writes into the state's own buffers; after the `last` chunk
    nothing does, and the memory is spared. Replay rows that are not filled yet are left out.
    """
    step = int(state.clock)
    payload = _payload(state, lanes, tally, _filled(state, step))
    small = {algo: {"actor": agent.actor, "critic": agent.critic} for algo, agent in state.agents.items()}
    if not last:
        payload, small = jax.jit(lambda tree: jax.tree.map(jnp.copy, tree))((payload, small))
    items = ocp.args.Composite(state=ocp.args.StandardSave(payload), networks=ocp.args.StandardSave(small))
    keeper.save(step, args=items)


def restore(
    keeper: ocp.CheckpointManager, state: TrainState, lanes: LaneData, tally: Tally
) -> tuple[TrainState, LaneData, Tally] | None:
    """The newest checkpoint, in the shapes and on the devices of the arguments; None where there is none yet.

    Raises:
        ValueError: the checkpoint cannot be read.
    """
    step = keeper.latest_step()
    if step is None:
        return None
    filled = _filled(state, step)
    wanted = jax.tree.map(ocp.utils.to_shape_dtype_struct, _payload(state, lanes, tally, filled))
    found = _read(keeper, step, state=ocp.args.StandardRestore(wanted))["state"]
    train_state: TrainState = found["state"]
    merge = jax.jit(lambda rows, new: rows.at[:, :filled].set(new), donate_argnums=0)
    replay = Replay(merge(state.replay.rows, train_state.replay.rows))
    return train_state._replace(replay=replay), lanes._replace(prior=found["prior"]), found["tally"]


def networks(directory: Path) -> dict[str, Any]:
    """``{"actor", "critic"}`` of every row, by algorithm, from the newest checkpoint of a run's directory.

    Raises:
        ValueError: there is no checkpoint, or it cannot be read.
    """
    if not directory.is_dir():
        raise ValueError(f"{directory} is not a directory of checkpoints: a finished run has one.")
    with manager(directory) as keeper:
        step = keeper.latest_step()
        if step is None:
            raise ValueError(f"{directory} holds no complete checkpoint: a finished run has one.")
        return _read(keeper, step, networks=ocp.args.StandardRestore(_on_one_device(directory, step)))["networks"]


def students(directory: Path) -> dict[str, Any]:
    """The actors alone; see `networks`."""
    return {algo: found["actor"] for algo, found in networks(directory).items()}


def _on_one_device(directory: Path, step: int) -> Any:
    """What the networks of a checkpoint look like on this machine, whatever devices the run had."""
    device = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    with ocp.StandardCheckpointer() as reader:
        stored = reader.metadata(directory.absolute() / str(step) / "networks").item_metadata
    return jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=device), dict(stored.tree))


def _filled(state: TrainState, step: int) -> int:
    """Replay rows worth keeping; at least one, since an empty array cannot be stored."""
    return min(max(step, 1), state.replay.rows.shape[1])


def _payload(state: TrainState, lanes: LaneData, tally: Tally, filled: int) -> dict[str, Any]:
    rows = state.replay.rows
    kept = Replay(rows if filled == rows.shape[1] else rows[:, :filled])  # a slice is a copy
    return {"state": state._replace(replay=kept), "prior": lanes.prior, "tally": tally}


def _read(keeper: ocp.CheckpointManager, step: int, **items: ocp.args.StandardRestore) -> Any:
    try:
        return keeper.restore(step, args=ocp.args.Composite(**items))
    except Exception as error:  # Orbax and its storage raise many kinds for a damaged file
        raise ValueError(
            f"checkpoint {step} in {keeper.directory} cannot be read ({type(error).__name__}); "
            "remove its folder to start again from the beginning, or restore it from a copy."
        ) from error
