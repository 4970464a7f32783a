"""srl_jax: survivable control of a legged robot in JAX."""
