"""Fields that are None, since nothing asked for them, leave no trace in what is stored.

So a checkpoint of a version that did not have such a field yet fits, and is the same as before.
"""

from typing import Any


def stored(value: Any) -> Any:
    """A named tuple, and those in it, as dicts of the fields that are not None."""
    if not hasattr(value, "_asdict"):
        return value
    return {name: stored(own) for name, own in value._asdict().items() if own is not None}


def restored(like: Any, found: Any) -> Any:
    """What `stored` was given, from what came back; `like` is made of the same named tuples."""
    if not hasattr(like, "_asdict"):
        return found
    return like._replace(**{name: restored(getattr(like, name), own) for name, own in found.items()})
