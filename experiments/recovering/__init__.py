"""The parts of `experiments.recovery`: what robots go through, by what methods they go on, and how that is scored."""
