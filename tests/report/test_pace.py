"""Speed over a second, along x or over ground."""

import numpy as np

from srl_jax.report.pace import rates, speeds


def test_speed_is_along_x_or_over_ground():
    path = np.cumsum(np.tile([0.03, 0.04, 9.0], (30, 1)), axis=0)
    np.testing.assert_allclose(speeds(path)[[0, 19, 29]], [0.03, 0.6, 0.6])
    np.testing.assert_allclose(speeds(path, "p2p")[[19, 29]], 1.0)
    np.testing.assert_allclose(speeds(path, window=5)[[4, 29]], 0.6)


def test_what_is_come_along_a_task_is_a_rate_as_well():
    path = np.cumsum(np.tile([0.03, 0.04], (30, 1)), axis=0)
    np.testing.assert_allclose(rates(path[:, 0]), speeds(path))
