"""The task that is asked for, from plain arguments as `gymnasium.make` hands them on."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from srl_jax.env.settings import TASKS, EnvConfig

Settings = Mapping[str, Any] | EnvConfig | None


def configured(task: str, settings: Settings) -> EnvConfig:
    """The task's settings, checked.

    Args:
        task: x, xy or p2p.
        settings: fields of `EnvConfig` that shall be others, such as ``{"observation": "onboard"}``, or a whole one.

    Raises:
        ValueError: an unknown task or field, a value that makes no task, or one that only the training program has.
    """
    if task not in TASKS:
        raise ValueError(f"task is {task!r}: choose one of {', '.join(TASKS)}.")
    if isinstance(settings, EnvConfig):
        config = settings
    else:
        names, wanted = [field.name for field in dataclasses.fields(EnvConfig)], settings or {}
        if unknown := [name for name in wanted if name not in names]:
            raise ValueError(f"settings has {unknown[0]!r}: choose from {', '.join(names)}.")
        config = EnvConfig(**wanted)
    config.check()
    if config.stride_starts:
        raise ValueError(f"env.stride_starts is {config.stride_starts}: starts in mid-stride are the program's own.")
    return config
