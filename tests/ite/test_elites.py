"""MAP-Elites: insertion against a plain loop, and what selection and mutation draw."""

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.ite import elites, family

KEY = jax.random.key(0)
ROWS = 400
mutate = jax.jit(elites.mutate)


def candidates(seed, rows=ROWS):
    """A batch that crowds 64 cells, with ties, killed gaits and NaN."""
    rng = np.random.default_rng(seed)
    descriptors = rng.choice([0.1, 0.3], (rows, 6)) + rng.choice([0.0, 0.05], (rows, 6))
    fitness = rng.integers(-4, 5, rows) / 4.0
    fitness[rng.uniform(size=rows) < 0.1] = -np.inf
    fitness[rng.uniform(size=rows) < 0.05] = np.nan
    genes = rng.integers(0, 21, (rows, 36)).astype(np.uint8)
    return elites.Batch(jnp.float32(fitness), jnp.asarray(genes), jnp.float32(descriptors))


def place(descriptor):
    """The cell of a descriptor in exact arithmetic, for hundredths."""
    index = 0
    for duty in descriptor:
        index = 5 * index + min(round(100 * float(duty)) // 20, 4)
    return index


def loop(batches):
    """A dict of cells, filled one candidate after the other."""
    cells = {}
    for batch in batches:
        for fitness, genes, descriptor in zip(*map(np.asarray, batch), strict=True):
            cell = place(descriptor)
            if np.isfinite(fitness) and (cell not in cells or fitness > cells[cell][0]):
                cells[cell] = (fitness, genes, descriptor)
    return cells


def test_insertion_is_that_of_a_plain_loop():
    archive, batches = elites.empty(), [candidates(seed) for seed in range(3)]
    for count in range(1, 4):
        archive = elites.insert(archive, batches[count - 1])
        expected = loop(batches[:count])
        filled = np.flatnonzero(np.isfinite(archive.fitness))
        assert filled.tolist() == sorted(expected)
        for cell, (fitness, genes, descriptor) in expected.items():
            assert archive.fitness[cell] == fitness
            np.testing.assert_array_equal(archive.genes[cell], genes)
            np.testing.assert_array_equal(archive.descriptors[cell], descriptor)
    assert not np.any(np.isnan(archive.fitness))


def test_a_batch_without_ties_may_come_in_any_order():
    batch = candidates(0)
    batch = batch._replace(fitness=jnp.where(jnp.isfinite(batch.fitness), jnp.arange(ROWS) / 7.0, batch.fitness))
    order = np.random.default_rng(1).permutation(ROWS)
    one, other = (elites.insert(elites.empty(), x) for x in (batch, jax.tree.map(lambda x: x[order], batch)))
    jax.tree.map(np.testing.assert_array_equal, one, other)


def test_cells_are_five_equal_bins_a_dimension():
    hundredths = np.arange(101)
    for dimension in range(6):
        for duty in (np.float32(hundredths / 100), np.float32(hundredths) * np.float32(0.01)):
            descriptors = np.zeros((101, 6), np.float32)
            descriptors[:, dimension] = duty
            found = jax.vmap(elites.cell)(descriptors)
            np.testing.assert_array_equal(found, np.minimum(hundredths // 20, 4) * 5 ** (5 - dimension))
    assert int(elites.cell(jnp.ones(6))) == elites.CELLS - 1 == 15_624


def test_mutation_redraws_a_twentieth_of_the_genes_and_at_least_one():
    parents = elites.sample(20_000, KEY)
    children = np.asarray(mutate(parents, jax.random.key(1)))
    changed = children != np.asarray(parents)
    counts = changed.sum(axis=1)
    assert children.max() <= 20 and counts.min() == 1
    single = 36 * 0.05 * 0.95**35 + 0.95**36  # one drawn, or none and then one
    assert abs(np.mean(counts == 1) - single) < 4 * np.sqrt(single / 20_000)
    rate = 0.05 + 0.95**36 / 36
    assert np.all(np.abs(changed.mean(axis=0) - rate) < 5 * np.sqrt(rate / 20_000))
    step = (children.astype(int) - np.asarray(parents))[changed] % 21
    share = np.bincount(step, minlength=21)[1:] / len(step)
    assert np.all(np.abs(share - 1 / 20) < 0.1 / 20)


def test_selection_is_uniform_over_filled_cells():
    archive = elites.insert(elites.empty(), candidates(0))
    filled = np.flatnonzero(np.isfinite(archive.fitness))
    marked = archive._replace(genes=archive.genes.at[filled, 0].set(jnp.arange(len(filled)).astype(jnp.uint8)))
    drawn = np.asarray(elites.select(marked, 64_000, KEY))[:, 0]
    share = np.bincount(drawn, minlength=len(filled)) / 64_000
    assert len(share) == len(filled) and np.all(np.abs(share - 1 / len(filled)) < 0.2 / len(filled))


def test_an_empty_archive_breeds_random_gaits_and_tripods():
    first = np.asarray(elites.breed(elites.empty(), 128, KEY))
    assert len(np.unique(first[1::2])) == 21
    amplitude, phase, duty = np.moveaxis(first[::2].reshape(64, 6, 2, 3).astype(int), -1, 0)
    for shared in (amplitude, duty):
        assert np.all(shared == shared[:, :1]) and np.ptp(shared[:, 0], axis=0).min() >= 15
    known = np.rint(20 * family.REFERENCE.reshape(6, 2, 3)[..., 1]).astype(int)
    moved = (phase - known) % 20
    assert np.all(moved[..., 0] == 0) and np.all(moved[..., 1] == moved[:, :1, 1]) and len(np.unique(moved)) > 10


def test_a_filled_archive_breeds_its_own():
    archive = elites.insert(elites.empty(), candidates(0))
    children = np.asarray(elites.breed(archive, 64, KEY)).astype(int)
    parents = np.asarray(archive.genes)[np.isfinite(archive.fitness)]
    distance = (children[:, None] != parents[None]).sum(-1).min(-1)
    assert distance.min() >= 1 and distance.max() <= 9


def test_a_step_evaluates_the_children_and_keeps_the_best():
    def evaluate(gaits):
        assert gaits.dtype == jnp.float32 and float(gaits.max()) <= 1.0
        return gaits.sum(axis=1), jnp.round(100 * gaits[:, :6]) / 100

    archive = elites.empty()
    for generation in range(20):
        before = archive
        archive, batch = elites.step(archive, evaluate, 64, jax.random.fold_in(KEY, generation))
        jax.tree.map(np.testing.assert_array_equal, archive, elites.insert(before, batch))
        assert np.all(np.asarray(archive.fitness) >= np.asarray(before.fitness))
    found = np.isfinite(archive.fitness)
    gaits = np.asarray(elites.gaits(archive.genes))[found]
    np.testing.assert_allclose(gaits.sum(axis=1), np.asarray(archive.fitness)[found], rtol=1e-6)
    assert archive.fitness.max() > 24.0  # 36 genes at random sum to 18 ± 1.8
