"""What settings of agents are made of: fields that may hold several values, and the range of each beside it.

A field of type `Sweep` may hold several values: each value adds lanes, never another program. Everything else is
static and shapes the compiled program. This module imports no jax, so that ``--help`` answers at once.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, NamedTuple, get_args, get_type_hints

from tyro.constructors import PrimitiveConstructorSpec


class Range(NamedTuple):
    """The accepted values of a number."""

    low: float
    high: float = math.inf
    above: bool = False  # `low` itself is not accepted

    def holds(self, value: float) -> bool:
        """Whether a value is accepted; NaN and infinity never are."""
        return math.isfinite(value) and (value > self.low if self.above else value >= self.low) and value <= self.high

    def __str__(self) -> str:
        if self.high < math.inf:
            return f"lie between {self.low:g} and {self.high:g}"
        if self.above:
            return "be positive" if self.low == 0.0 else f"be above {self.low:g}"
        return "not be negative" if self.low == 0.0 else f"be at least {self.low:g}"


def _parse(args: list[str]) -> tuple[float, ...]:
    return tuple(float(part) for part in args[0].split(","))


Sweep = Annotated[
    tuple[float, ...],
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="FLOAT[,FLOAT...]",
        instance_from_str=_parse,
        is_instance=lambda x: isinstance(x, tuple) and all(isinstance(v, (int, float)) for v in x),
        str_from_instance=lambda x: [",".join(repr(v) for v in x)],
    ),
]
Share = Annotated[Sweep, Range(0.0, 1.0)]
NotNegative = Annotated[Sweep, Range(0.0)]
Positive = Annotated[Sweep, Range(0.0, above=True)]
Count = Annotated[int, Range(1)]


@dataclass(frozen=True)
class AgentSettings:
    """The base of every algorithm's settings; the class variables say what a run must offer."""

    tasks: ClassVar[tuple[str, ...] | None] = None  # it can do no others
    episode_steps: ClassVar[int | None] = None  # it needs episodes of exactly this length
    first_teacher: ClassVar[str | None] = None  # it needs this one as pi_B
    one_damage: ClassVar[bool] = False  # all robots of a lane must carry the same
    solves: ClassVar[bool] = True  # it may solve linear systems, by LAPACK (see `cli.devices`)

    def __post_init__(self) -> None:
        """A single number stands for a sweep of one value."""
        for name in swept_fields(type(self)):
            value = getattr(self, name)
            if isinstance(value, (int, float)):
                object.__setattr__(self, name, (float(value),))

    def check(self, name: str) -> None:
        """Raises ValueError where a number of the algorithm called `name` lies outside its range."""
        for field, hint in _hints(type(self)).items():
            value = getattr(self, field)
            for accepted in (part for part in getattr(hint, "__metadata__", ()) if isinstance(part, Range)):
                values = value if isinstance(value, tuple) else (value,)
                if not values or not all(accepted.holds(number) for number in values):
                    shown = ",".join(f"{number:g}" for number in values) or "empty"
                    raise ValueError(f"{name}.{field} is {shown}: it must {accepted}.")


@cache
def _hints(settings: type) -> dict[str, Any]:
    """The types of the fields, class variables left out."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(settings)}


@cache
def swept_fields(settings: type) -> tuple[str, ...]:
    """The names of the fields that may hold several values, in order."""
    spec = get_args(Sweep)[1]
    return tuple(name for name, hint in _hints(settings).items() if spec in getattr(hint, "__metadata__", ()))


def variants(config: AgentSettings) -> Iterator[dict[str, float]]:
    """Every combination of the fields that were given several values, as overrides for `hyper.from_config`."""
    swept = {name: getattr(config, name) for name in swept_fields(type(config)) if len(getattr(config, name)) > 1}
    for values in itertools.product(*swept.values()):
        yield dict(zip(swept, values, strict=True))


def first_values(config: Any) -> Any:
    """The settings with the first value of every sweep alone: one lane instead of several."""
    return dataclasses.replace(config, **{name: getattr(config, name)[:1] for name in swept_fields(type(config))})
