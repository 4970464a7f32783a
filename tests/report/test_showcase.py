"""What is shown of a method is its median lane."""

import numpy as np

from srl_jax.program.lanes import Lane
from srl_jax.report.showcase import median_lanes


def test_the_median_lane_of_every_method_is_shown():
    lanes = [
        Lane(i, algo, seed, "x", "leg_rm") for i, (algo, seed) in enumerate((a, s) for a in "ab" for s in range(5))
    ]
    lanes += [Lane(10, "a", 0, "x", "leg_rm", (("beta", 0.5),)), Lane(11, "c", 0, "x", "leg_rm")]
    returns = dict(enumerate([5.0, 1.0, 4.0, 2.0, 3.0, 9.0, np.nan, 8.0, 7.0, np.inf, -1.0, np.nan]))
    del returns[8]
    chosen = median_lanes(lanes, returns)
    assert {name: lane.index for name, lane in chosen.items()} == {"a": 4, "b": 7, "a beta=0.5": 10}
