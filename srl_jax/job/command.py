"""What a run was told, on top of the preset that is nearest: what differs, and the command that gives it again.

No jax is imported here.
"""

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from srl_jax.agents import registry
from srl_jax.agents.sweep import AgentSettings, swept_fields
from srl_jax.config import Config, Preset, preset
from srl_jax.job.files import config_of
from srl_jax.report.content import Asked, Change


def asked(settings: Mapping[str, Any], label: str = "") -> Asked:
    """What stands in a run's config.json under `config`.

    Args:
        settings: as plain JSON; those of another version are listed as they are, and have no command.
        label: of a sweep's point.
    """
    name, changes = nearest(settings)
    try:
        command = again(config_of(dict(settings), Path("config.json")))
    except ValueError:
        command = ""
    return Asked(label, name, changes, command)


def again(config: Config) -> str:
    """The command that trains the same lanes again, in a directory of its own."""
    name, changes = nearest(plain(config))
    words = ["srl-jax", "run", *(["--preset", name] if name != "default" else [])]
    return shlex.join([*words, *(word for change in changes for word in _option(config, change.name))])


def plain(config: Config) -> dict[str, Any]:
    """A configuration as config.json has it."""
    return json.loads(json.dumps(asdict(config)))


def nearest(settings: Mapping[str, Any]) -> tuple[str, list[Change]]:
    """The preset that fewest settings differ from, and these."""
    own = _flat(settings)
    found = []
    for name in get_args(Preset):
        known = [other for other in settings.get("more", {}) if other in registry.names()]
        base = _flat(plain(preset(name).with_agents(**{other: registry.settings(other) for other in known})))
        changes = [Change(path, value, base.get(path)) for path, value in own.items() if base.get(path) != value]
        found.append((name, changes))
    return min(found, key=lambda item: len(item[1]))


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    # section.field -> value; algorithms from outside the package have sections as others do.
    apart = {name: value for name, value in settings.items() if name != "more"} | settings.get("more", {})
    found = {}
    for name, value in apart.items():
        found |= {f"{name}.{field}": x for field, x in value.items()} if isinstance(value, Mapping) else {name: value}
    return found


def _option(config: Config, name: str) -> list[str]:
    section, _, field = name.rpartition(".")
    owner: Any = (getattr(config, section, None) or config.more[section]) if section else config
    value, flag = getattr(owner, field), "--" + name.replace("_", "-")
    if isinstance(value, bool):
        return [flag if value else f"--{section}.no-{field}".replace("_", "-")]
    if isinstance(owner, AgentSettings) and field in swept_fields(type(owner)):
        value = ",".join(map(repr, value))
    words = [str(part) for part in value] if isinstance(value, tuple) else [str(value)]
    # What begins with a minus would be taken for an option.
    return [f"{flag}={words[0]}"] if len(words) == 1 and words[0].startswith("-") else [flag, *words]
