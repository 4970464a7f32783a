"""The parts of `experiments.estimator`: walks, the network that learns from them, and how beliefs are judged."""
