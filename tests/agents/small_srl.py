"""A small SRL agent that several tests share, with networks of eight units and a teacher of high actions."""

import jax
import jax.numpy as jnp

from srl_jax.agents import ddpg, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import SRLConfig
from tests.agents.reference import ACTION, OBSERVATION, convinced_critic

SHARED = dict(
    critic_updates=1,
    tau=(0.01,),
    hidden=(8, 8),
    layer_norm=False,
    critics=2,
    freeze=(0.0,),
    actor_lr=(1e-2,),
    critic_lr=(1e-2,),
)
FULL = SRLConfig(**SHARED, dropout=(0.3,), draws=8)
OFF = SRLConfig(**SHARED, select=False, guidance_weight=(0.0,), bootstrap=(1.0,), weight_decay=(0.0,))
STATIC = ("config", "teachers")
update = jax.jit(srl.update, static_argnames=STATIC)
init = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=FULL))
student = jax.jit(lambda actor, observation: ddpg.student(actor, observation, config=FULL))
KEY, STEP = jax.random.key(0), jnp.float32(1e4)


def high(observation: jax.Array) -> jax.Array:
    """A teacher whose advice is a large sum of actions."""
    return 0.8 + 0.0 * observation[:ACTION]


def start(seed: int = 0) -> ddpg.AgentState:
    other = init(jax.random.key(seed + 100))
    return init(jax.random.key(seed))._replace(target_actor=other.actor, target_critic=other.critic)


def convinced(slope: float) -> ddpg.AgentState:
    """An agent whose members all believe ``Q(s, a) = slope (4 + sum(a))``."""
    state = start()
    critic = convinced_critic(state.critic, slope, OBSERVATION)
    return state._replace(critic=critic, target_critic=critic)


def run(state, batch, config, key=KEY, teachers=(), **overrides):
    hyper = from_config(config, **overrides)
    return update(state, batch, key, config=config, hyper=hyper, step=STEP, teachers=teachers)
