"""Who touches whom and how they give way, against C MuJoCo on robots drawn at random."""

import jax
import mujoco
import numpy as np
import pytest

from srl_jax.env.star import rows
from srl_jax.env.star.contacts import floor_and_spheres, meeting, pairs, softness
from tests.env.star.robots import crab, hopper


def attributes(rng: np.random.Generator) -> str:
    """A geom that touches some others, with numbers of its own."""
    pick = lambda *values: values[rng.integers(len(values))]  # noqa: E731
    solref = pick("0.02 1", "0.05 0.8", "-100 -10")
    return (
        f'contype="{rng.integers(4)}" conaffinity="{rng.integers(4)}" condim="{pick(1, 3, 4, 6)}" '
        f'priority="{pick(0, 0, 0, 1, -1)}" solmix="{pick(0, 1, 1, 3, 1e-20)}" solref="{solref}" '
        f'friction="{rng.uniform(0.1, 1)}" margin="{pick(0, 0.01)}" '
        f'solimp="{rng.uniform(0.5, 0.8)} {rng.uniform(0.9, 0.99)} 0.002 {rng.uniform(0.2, 0.8)} {pick(2, 3)}"'
    )


def heap(seed: int) -> mujoco.MjModel:
    """A base with two chains, all of whose spheres and the floor lie within one another; some pairs are excluded."""
    rng = np.random.default_rng(seed)
    geoms = lambda: "".join(f'<geom size="0.1" mass="1" {attributes(rng)}/>' for _ in range(rng.integers(1, 3)))  # noqa: E731
    link = lambda name, inside: f'<body name="{name}"><joint/>{geoms()}{inside}</body>'  # noqa: E731
    arm, leg = link("shoulder", link("elbow", "")), link("hip", link("knee", link("ankle", "")))
    names = ["world", "base", "shoulder", "elbow", "hip", "knee", "ankle"]
    excluded = [rng.choice(len(names), 2, replace=False) for _ in range(3)]
    lines = {f'<exclude body1="{names[a]}" body2="{names[b]}"/>' for a, b in map(sorted, excluded)}
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <worldbody>
        <geom type="plane" size="0 0 1" {attributes(rng)}/>
        <body name="base"><freejoint/>{geoms()}{arm}{leg}</body>
      </worldbody>
      <contact>{"".join(lines)}</contact>
    </mujoco>""")


@pytest.mark.parametrize("seed", range(20))
def test_pairs_and_their_numbers_are_those_of_mujoco(seed):
    model = heap(seed)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = {
        tuple(sorted(geoms)): contact for geoms, contact in zip(data.contact.geom.tolist(), data.contact, strict=True)
    }
    assert set(pairs(model)) == set(found)
    for (a, b), contact in found.items():
        met = meeting(model, a, b)
        assert met.condim == contact.dim
        assert met.friction == pytest.approx(contact.friction[0])
        assert met.margin == pytest.approx(contact.includemargin)
        np.testing.assert_allclose(met.solref, contact.solref, rtol=1e-9)
        np.testing.assert_allclose(met.solimp, contact.solimp, rtol=1e-9)


def test_heaps_have_pairs():
    assert sum(len(list(pairs(heap(seed)))) for seed in range(20)) > 200


def test_the_floor_and_what_it_carries():
    model = crab()
    floor, spheres = floor_and_spheres(model)
    assert model.geom(floor).name == "floor"
    assert [model.geom(geom).name for geom in spheres] == ["keel", "tip", "thumb", "finger", "knee"]


SOLIMPS = ("0.9 0.95 0.001 0.5 2", "0 1 0.03 0.3 2", "0.2 0.99999 0.001 0.99999 2", "0.2 0.8 1 0 2")


@pytest.mark.parametrize("solref", ["0.02 1", "0.001 0.7", "0.1 1.5"])
@pytest.mark.parametrize("solimp", SOLIMPS)
def test_rows_give_way_as_those_of_mujoco(solref, solimp):
    """The rows of a foot at several depths, and of a joint beyond its limit."""
    foot = ('contype="1"', f'contype="1" priority="1" solref="{solref}" solimp="{solimp}"')
    model = hopper(foot, ('name="hinge"', f'name="hinge" solreflimit="{solref}" solimplimit="{solimp}"'))
    data, soft = mujoco.MjData(model), softness(solref.split(), solimp.split(), model.opt.timestep)
    for depth in (1e-4, 5e-4, 2e-3, 0.05):
        data.qpos[:] = [0, 0, 0.08 - depth, 1, 0, 0, 0, np.pi / 3 + depth]
        mujoco.mj_forward(model, data)
        limit = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        assert limit.tolist() == [True] + [False] * 4
        np.testing.assert_allclose(data.efc_KBIP[:, 0], soft.stiffness)
        np.testing.assert_allclose(data.efc_KBIP[:, 1], soft.damping)
        with jax.enable_x64(True):
            impedance = np.asarray(rows.impedance(soft, np.abs(data.efc_pos)))
            weight = rows.row_weight(model.dof_invweight0[6], impedance[limit])
        np.testing.assert_allclose(data.efc_KBIP[:, 2], impedance)
        np.testing.assert_allclose(data.efc_D[limit], weight)
