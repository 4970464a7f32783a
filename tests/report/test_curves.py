"""Figures show the curves that were put in, and stay readable with many methods and many damages."""

from itertools import pairwise

import matplotlib.figure
import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_hex

from srl_jax.env import hexapod
from srl_jax.report import curves, panels, style
from srl_jax.report.data import Group, read_metrics
from tests.report.runs import DAMAGES, METHODS, SEEDS, STEPS, scaled, write

MANY = {("srl", ""): 0.3} | {("srl", f"beta={n / 20:g}"): 0.3 + n / 40 for n in range(19)}


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved, as objects."""
    figures, real = [], style.save
    monkeypatch.setattr(style, "save", lambda figure, path: (figures.append(figure), real(figure, path)))
    return figures


def lines(axes):
    """Colour -> heights of the curves of a panel; the bare lines across it have two points."""
    return {to_hex(line.get_color()): line.get_ydata() for line in axes.lines if len(line.get_xdata()) > 2}


@pytest.mark.parametrize("task", ["p2p", "x"])
@pytest.mark.parametrize(("seeds", "damages"), [(SEEDS, DAMAGES), (SEEDS[:1], DAMAGES[:1])])
def test_curves_are_drawn(tmp_path, drawn, task, seeds, damages):
    methods = METHODS if len(seeds) > 1 else {("srl", ""): 0.6}
    run = read_metrics(write(tmp_path, methods=methods, task=task, seeds=seeds, damages=damages))
    curves.save_curves(run, tmp_path / "curves.png")
    image = matplotlib.image.imread(tmp_path / "curves.png")
    assert image.shape[0] > 600 and image.shape[1] > 1500
    blue = np.abs(image[..., :3] - np.array([0x00, 0x72, 0xB2]) / 255).max(axis=-1) < 0.02
    assert blue.sum() > 500
    (figure,) = drawn
    assert len(figure.axes) == 2 + (len(damages) if len(damages) > 1 else 0)
    scale = {"p2p": (1.0, 100.0), "x": (100.0, 2.0)}[task]
    for axes, unit in zip(figure.axes, scale, strict=False):
        expected = unit * (0.6 * np.arange(4) / 3 + 0.01 * np.mean(seeds))
        np.testing.assert_allclose(lines(axes)[style.FIXED["srl"].lower()], expected)
    assert not list(tmp_path.glob("*.partial"))


def test_a_small_panel_shows_its_own_damage(tmp_path, drawn):
    factors = {lane: {"eval/success": 0.5} for lane in range(2, 12, 3)}  # leg 2 of a single method
    run = read_metrics(write(tmp_path, methods={("srl", ""): 0.6}, edit=scaled(factors)))
    curves.save_curves(run, tmp_path / "curves.png")
    small = {axes.get_title(): lines(axes)[style.FIXED["srl"].lower()] for axes in drawn[0].axes[2:]}
    expected = 0.6 * np.arange(4) / 3 + 0.045
    for damage, factor in zip(DAMAGES, (1.0, 1.0, 0.5), strict=True):
        np.testing.assert_allclose(small[damage], factor * expected)


def test_the_dotted_line_is_the_mean_threshold_and_the_dashed_one_the_teacher(tmp_path, drawn):
    run = read_metrics(write(tmp_path, edit=scaled({0: {"healthy/return": 3.0}})))
    curves.save_curves(run, tmp_path / "curves.png")
    flat = [line.get_ydata()[0] for line in drawn[0].axes[1].lines if len(line.get_xdata()) == 2]
    assert flat == pytest.approx([12.0, 0.9 * 49.5 * (1 + 2 / 36)])


def test_each_stage_of_a_schedule_has_its_teachers_height(tmp_path, drawn):
    def staged(rows):
        return rows + [(150, i, m, 2 * x) for s, i, m, x in rows if m.startswith("teacher/")]

    run = read_metrics(write(tmp_path, damages=DAMAGES[:1], edit=staged))
    curves.save_curves(run, tmp_path / "curves.png")
    (stairs,) = [line for line in drawn[0].axes[1].lines if line.get_drawstyle() == "steps-post"]
    assert (list(stairs.get_xdata()), list(stairs.get_ydata())) == ([0, 150, STEPS[-1]], [12.0, 24.0, 24.0])


def test_of_many_methods_the_highest_have_names(tmp_path, drawn):
    run = read_metrics(write(tmp_path, methods=MANY, seeds=SEEDS[:1]))
    curves.save_curves(run, tmp_path / "curves.png")
    (legend,) = drawn[0].legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names[:-1] == [f"SRL beta={n / 20:g}" for n in range(11, 19)]
    assert names[-1] == "12 that end lower"
    large, small = drawn[0].axes[0], drawn[0].axes[2]
    assert len([line for line in large.lines if len(line.get_xdata()) > 2]) == 20
    assert len([line for line in small.lines if len(line.get_xdata()) > 2]) == 8
    box = legend.get_window_extent()
    assert box.x0 >= 0 and box.x1 <= drawn[0].bbox.x1  # nothing hangs over the edge


@pytest.mark.parametrize(("count", "saved"), [(15, True), (76, False)])  # laying out 76 panels takes seconds
def test_every_damage_has_a_panel_beside_the_others(tmp_path, monkeypatch, count, saved):
    figures, real = [], style.save
    monkeypatch.setattr(style, "save", lambda figure, path: (figures.append(figure), saved and real(figure, path)))
    damages = tuple(f"leg {n}" for n in range(count))
    small = {"methods": {("srl", ""): 0.5}, "seeds": SEEDS[:1], "damages": damages}
    edit = lambda rows: [row for row in rows if row[2].startswith("eval/") and row[0] in (0, 300)]  # noqa: E731
    curves.save_curves(read_metrics(write(tmp_path, **small, edit=edit)), tmp_path / "curves.png")
    panels = [axes for axes in figures[0].axes[2:] if axes.axison]
    assert [axes.get_title() for axes in panels] == list(damages)
    boxes = [axes.get_window_extent() for axes in panels[:7]]
    assert all(left.x1 < right.x0 and left.y0 == right.y0 for left, right in pairwise(boxes))
    assert len({axes.get_ylim() for axes in panels}) == 1


def test_panels_stand_side_by_side_whatever_their_methods(tmp_path, drawn):
    one = read_metrics(write(tmp_path / "x", task="x", methods={("srl", ""): 0.6}))
    two = read_metrics(write(tmp_path / "p2p", methods={("ddpg", ""): 0.2, ("srl", ""): 0.6}))
    curves.save_panels([one, two], "eval/return", tmp_path / "figure.png")
    assert [axes.get_title(loc="left") for axes in drawn[0].axes] == [
        *("x: return per episode", "p2p: return per episode")
    ]
    assert {len(lines(axes)) for axes in drawn[0].axes} == {1, 2}
    assert {text.get_text() for text in drawn[0].legends[0].get_texts()} == {"DDPG", "SRL"}


def test_nothing_to_draw_is_one_sentence(tmp_path):
    run = read_metrics(write(tmp_path, edit=lambda rows: [row for row in rows if row[2].startswith("train/")]))
    with pytest.raises(ValueError, match="Nothing to draw: the run of task 'p2p'"):
        curves.save_curves(run, tmp_path / "curves.png")


def test_half_a_figure_is_never_left(tmp_path, monkeypatch):
    (tmp_path / "curves.png").write_text("the old one")

    def killed(self, path, **options):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", killed)
    with pytest.raises(KeyboardInterrupt):
        curves.save_curves(read_metrics(write(tmp_path)), tmp_path / "curves.png")
    assert (tmp_path / "curves.png").read_text() == "the old one"


def test_named_looks_differ_and_the_papers_methods_keep_theirs():
    groups = [Group("mcpg", ""), Group("srl", ""), Group("ddpg", ""), *(Group("srl", f"v={n}") for n in range(5))]
    looks = style.looks(groups, groups)
    assert len({(str(look["linestyle"]), look["color"]) for look in looks.values()}) == len(groups)
    assert (looks[groups[1]]["color"], looks[groups[2]]["color"]) == (style.FIXED["srl"], style.FIXED["ddpg"])


def test_robot_time_is_the_robots():
    assert panels.CONTROL_HZ == hexapod.CONTROL_HZ
