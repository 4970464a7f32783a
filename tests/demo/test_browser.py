"""The page in a real browser: its robot is the package's, a click breaks it, and it recovers."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import file, recovery
from srl_jax.atlas.mind import widened
from srl_jax.atlas.stored import policies
from srl_jax.cli import demo
from srl_jax.demo import page as pages
from srl_jax.env.damage import damaged_model
from srl_jax.env.senses import ANGLES, GRAVITY, GYROSCOPE, Senses
from srl_jax.portable import rounded
from srl_jax.show.walk import Walk
from srl_jax.show.walker import by_policy
from tests.browsing import _browser, needs_chromium, watched  # noqa: F401  a fixture

pytestmark = needs_chromium
STEPS = 300  # physics steps: five seconds


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("page") / "demo.html"
    pages.write(out, demo.assembled(demo.Arguments(damages="losses21")))
    return out


@pytest.fixture
def opened(browser, written):
    """The page, its clock stopped."""
    with watched(browser, viewport={"width": 1000, "height": 720}) as page:
        page.goto(f"{written.as_uri()}?paused&plain")
        page.wait_for_function("window.demo", timeout=60_000)
        yield page


@pytest.mark.parametrize("damage", ["healthy", "leg_rm"])
def test_its_robot_is_that_of_the_package(opened, damage):
    """The same policy from the same start, without noise; the physics that policies are trained in."""
    walk = Walk(by_policy(rounded(policies(file.load())[damage])), damage, strike=0, model=damaged_model)
    opened.evaluate(
        """([damage, qpos, phase]) => {
            demo.story.begin(0, 'told');
            demo.story.patience = 0;
            if (damage !== 'healthy') demo.story.lose(damage);
            const { robot } = demo.story;
            robot.data.qpos.set(qpos);
            Object.assign(robot, { noise: 0, phase });
            robot.feel();
        }""",
        [damage, walk.data.qpos.tolist(), walk.phase],
    )
    # Observations here are of single precision; after a second that is nothing yet, after five contacts magnify it.
    for steps, places, atol in ((60, 25, 1e-5), (STEPS - 60, 3, 1e-3)):
        opened.evaluate(f"demo.run({steps})")
        found, expected = opened.evaluate("demo.state()"), list(walk.until(steps // 3))[-1].qpos
        np.testing.assert_allclose(found["qpos"][:places], expected[:places], atol=atol)
    assert found["damage"] == found["walker"] == damage
    assert expected[0] > 1.0


def test_a_click_breaks_it_and_it_finds_out_and_recovers(opened, tmp_path):
    opened.evaluate(f"demo.run({STEPS})")
    before = opened.evaluate("demo.state()")
    assert before["damage"] == "healthy" and before["likely"][0]["name"] == "healthy" and before["speed"] > 0.6
    opened.evaluate("demo.show()")
    leg = opened.evaluate("demo.scene.screen('tibia_rm')")
    opened.mouse.click(leg["x"], leg["y"])
    opened.evaluate("demo.run(174)")
    struck = opened.evaluate("demo.state()")
    assert struck["damage"] == "leg_rm" and struck["walker"] == before["walker"], "it knows nothing yet"
    assert struck["likely"][0]["name"] == "leg_rm" and struck["likely"][0]["share"] > 0.9
    struggling = opened.evaluate("demo.story.speed(demo.story.past.length - 1, 50)")
    opened.evaluate("demo.run(306)")
    after = opened.evaluate("demo.state()")
    assert struggling < 0.7 * before["speed"] < after["speed"] and not after["tipped"]
    opened.evaluate("demo.run(900); demo.show()")  # fifteen seconds on, it still walks
    assert opened.evaluate("demo.state()")["speed"] > 0.7 * before["speed"]
    assert opened.inner_text("#damage") == "leg_rm" and opened.locator("[data-leg=rm].gone").count() == 1
    opened.screenshot(path=Path(os.environ.get("SRL_JAX_SCREENSHOTS", tmp_path)) / "demo.png")


def test_what_the_page_has_no_damage_for_is_said(opened):
    opened.evaluate("['leg_rf', 'leg_rm', 'leg_rr'].forEach((leg) => demo.lose(leg))")
    assert opened.evaluate("demo.state()")["damage"] == "leg_rf+leg_rm+leg_rr"
    opened.evaluate("demo.lose('leg_lf')")
    assert "no robot with leg_lf" in opened.inner_text("#status")
    opened.click("#repair")
    assert opened.evaluate("demo.state()")["damage"] == "healthy"
    assert opened.locator(".gone").count() == 0


def test_it_doubts_as_the_package_does(opened):
    """The page's bank of observers and its belief, against the package's on the same actions and senses."""
    rows = opened.evaluate(
        """() => {
            const { story } = demo, { mind } = story, rows = [], doubt = mind.doubt.bind(mind);
            mind.forget();
            mind.doubt = (action, felt, answering) => {
                doubt(action, felt, answering);
                rows.push({ action, felt: Array.from(felt), answering, belief: Array.from(mind.belief) });
            };
            demo.run(60);
            demo.lose('leg_rm');
            demo.run(60);
            delete mind.doubt;
            return rows;
        }"""
    )
    names, atlas = opened.evaluate("demo.story.mind.atlas.damages"), file.load()
    mind = recovery.mind_of(atlas)
    known = recovery.knowledge(atlas)
    scope = recovery.scope(atlas, [name for name in atlas.damages if name not in names])
    places = [atlas.damages.index(name) for name in names] + [-1]
    memory, (known, scope) = mind.begin(known, scope, jax.random.key(0)), widened(known, scope)
    doubt = jax.jit(mind.doubt)
    unread = dict(speeds=np.zeros(18), towards=np.zeros(2), distance=np.zeros(()), come=np.zeros(()))
    for row in rows:
        felt = np.array(row["felt"], np.float32)
        read = dict(joints=felt[ANGLES], gyroscope=felt[GYROSCOPE], gravity=felt[GRAVITY])
        senses = Senses(answering=np.array(row["answering"]), **read, **unread)
        states, belief = doubt(known, scope, memory._replace(action=jnp.array(row["action"])), senses)
        memory = memory._replace(states=states, belief=belief)
        np.testing.assert_allclose(np.exp(row["belief"]), np.exp(belief.log)[places], atol=0.05)
    assert len(rows) == 40 and atlas.damages[int(np.argmax(memory.belief.log))] == "leg_rm"
