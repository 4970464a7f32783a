"""Numeric hyper-parameters as arrays, so that lanes may differ in them without another program."""

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.agents.settings import AgentConfig


class Hyper(NamedTuple):
    """One lane's values, each f32[]; meanings stand at the fields of the same name in `config`.

    DDPG reads the first group only, SRL two, an episodic search the third, then Bayesian actor-critic and
    intelligent trial and error;
    what an agent lacks is zero for it.
    """

    actor_lr: jax.Array
    critic_lr: jax.Array
    gamma: jax.Array
    tau: jax.Array
    noise: jax.Array
    noise_decay: jax.Array
    noise_floor: jax.Array
    noise_correlation: jax.Array
    freeze: jax.Array

    dropout: jax.Array
    beta: jax.Array
    psi: jax.Array
    guidance_weight: jax.Array
    guidance_decay: jax.Array
    prior_fraction: jax.Array
    prior_decay: jax.Array
    bootstrap: jax.Array
    weight_decay: jax.Array
    alpha: jax.Array
    precision: jax.Array

    search_rate: jax.Array
    spread: jax.Array
    spread_floor: jax.Array
    return_noise: jax.Array

    kernel_length: jax.Array
    value_scale: jax.Array
    advantage_scale: jax.Array
    reward_noise: jax.Array

    rho: jax.Array
    prior: jax.Array
    trial_noise: jax.Array
    kappa: jax.Array
    sufficient: jax.Array


def from_config(config: AgentConfig, **chosen: float) -> Hyper:
    """The hyper-parameters of a config, with `chosen` values in place of its first ones."""
    values = {name: getattr(config, name, (0.0,))[0] for name in Hyper._fields} | chosen
    return Hyper(**{name: jnp.float32(value) for name, value in values.items()})


def variants(config: AgentConfig) -> list[dict[str, float]]:
    """Every combination of the fields that were given several values, as overrides for `from_config`."""
    swept = {name: getattr(config, name) for name in Hyper._fields if len(getattr(config, name, ())) > 1}
    return [dict(zip(swept, values, strict=True)) for values in itertools.product(*swept.values())]
