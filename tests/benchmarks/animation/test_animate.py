"""The animation: what the recorded page holds, decoded as its player does, against the plan's own
motion and limits.
"""

import json
import re
import shutil
from base64 import b64decode
from dataclasses import replace
from html import unescape
from importlib.resources import files

import msgspec
import numpy as np
import pytest
import zstandard
from scipy.spatial.transform import Rotation

from benchmarks.animation import animate, four_views, save_four_views
from benchmarks.animation.animate import DARK, END_HOLD_TIME, POLICY, document
from benchmarks.animation.frames import (
    DRAWN_ERROR_SHARE,
    MAX_PATH_INSTANTS,
    MIN_PATH_INSTANTS,
    RAMP,
    VIEWS,
    colour_uses,
    compute_frames,
    count_instants,
    even_instants,
    magnification,
    nearest,
    parse_colour,
    tilt_use,
)
from kinematics import Axis, Machine, MotionError, load_machine
from kinematics.machine.pose import to_numbers
from kinematics.machine.shaper import Shaper
from planner import Line, Program, load_program, plan
from tests.browser import browse, needs_browser

SIZE = 1_500_000
"""Bytes that 240 frames may take."""
PROGRAMS = {
    "hexapod": "circle",
    "arm": "arm-circle",
    "tripod": 'length = "mm"\nangle = "deg"\n[[segment]]\nline = { to = [3, 0, -4] }\n[[segment]]\n'
    'arc = { centre = [0, 0, -4], normal = [0, 0, 1], angle = 360 }\nspeed = "20 mm/s"\n',
    "linkage": 'length = "mm"\nangle = "deg"\n[[segment]]\nline = { to = [40, 0, 0] }\n[[segment]]\n'
    "arc = { centre = [0, 0, 0], normal = [0, 0, 1], angle = 360 }\n",
    "traverser": 'length = "mm"\nangle = "deg"\n[[segment]]\nline = { to = [60, 80, 50], rotate = [0, 0, 40] }\n'
    "[[segment]]\narc = { centre = [60, 60, 50], normal = [0, 0, 1], angle = 360 }\n",
}


@pytest.fixture(scope="module", params=PROGRAMS)
def shown(request, tmp_path_factory):
    """A plan on each kind of machine."""
    if request.param == "arm":
        pytest.importorskip("pinocchio")
    text = PROGRAMS[request.param]
    if "\n" in text:
        file = tmp_path_factory.mktemp("programs") / "way.toml"
        file.write_text("schema = 1\n" + text)
        text = str(file)
    return plan(load_program(text), load_machine(request.param), order=2)


@pytest.fixture(scope="module")
def page(shown):
    return document(shown)


@pytest.fixture(scope="module")
def circle(plan_bundled):
    return plan_bundled("bare-circle", "hexapod", 3)


class Recording:
    """The messages of a page, with the time of each, and the arrays that they name."""

    def __init__(self, page):
        packed = b64decode(re.search(r'window\.__VISER_EMBED_DATA__="([^"]+)"', page).group(1))
        size = int.from_bytes(packed[:8], "little")
        inner = zstandard.ZstdDecompressor().decompress(packed[8:], max_output_size=size)
        length = int.from_bytes(inner[:8], "little")
        record = msgspec.msgpack.decode(inner[8 : 8 + length])
        self.duration, self.messages, at = record["durationSeconds"], record["messages"], 8 + length
        self.buffers = []
        for count in record["binaryBufferLengths"]:
            at += -at % 8
            self.buffers.append(inner[at : at + count])
            at += count

    def series(self, name, what, dtype=np.float32):
        """Time and value of a batch's property: as it was made, then each time that it changed."""
        found = []
        for t, message in self.messages:
            if message.get("name") == name:
                values = message.get("updates") or message.get("props") or {}
                if what in values:
                    found.append(
                        (t, np.frombuffer(self.buffers[values[what]["__binary_index"]], dtype))
                    )
        return [t for t, _ in found], [value for _, value in found]

    def of(self, kind):
        return [(t, message) for t, message in self.messages if message["type"] == kind]


def at_frames(times, values, frames):
    """What a player shows at the instant of each frame: the last value set by then."""
    return np.stack([values[np.searchsorted(times, t + 1e-9, side="right") - 1] for t in frames])


def test_240_frames_take_at_most_a_megabyte_and_a_half(page):
    assert len(page.encode()) <= SIZE


def test_frames_are_even_in_time_and_one_second_is_one_second(shown, page):
    recording = Recording(page)
    duration = shown.trajectory.duration
    assert recording.duration == pytest.approx(duration + END_HOLD_TIME, rel=1e-12)
    ticks = [
        (t, m["position"][0]) for t, m in recording.of("SetPositionMessage") if m["name"] == "/time"
    ]
    times = sorted({t for t, _ in ticks})
    np.testing.assert_allclose(
        times, np.linspace(0, duration, 240)[1:], atol=1e-9
    )  # the first is how it begins
    assert all(
        t == pytest.approx(at, abs=1e-9) for t, at in ticks
    )  # what the page's legend goes by


def told_by(page):
    """What the page's script goes by."""
    return json.loads(
        re.search(r'<script type="application/json" id="frames">(.*?)</script>', page, re.DOTALL)[1]
    )


def test_lengths_and_place_of_every_frame_are_those_of_the_motion(shown, page):
    """Rounded to a thousandth of a mm or degree; the tool's place as programs have it, from
    home.
    """
    data, machine = told_by(page), shown.machine
    state = shown.trajectory.at(np.linspace(0, shown.trajectory.duration, 240))
    scale = np.array([1e3 if axis.unit == "m" else 180 / np.pi for axis in machine.axes])
    assert data["axes"] == [axis.name for axis in machine.axes]
    assert data["units"] == ["mm" if axis.unit == "m" else "°" for axis in machine.axes]
    np.testing.assert_allclose(data["q"], state.q * scale, atol=5.01e-4)
    home = machine.home
    turned = (home.rotation.inv() * state.pose.rotation).as_matrix()
    place = (state.pose.translation - home.translation) @ home.rotation.as_matrix()
    np.testing.assert_allclose(np.array(data["pose"])[:, :3], 1e3 * place, atol=5.01e-4)
    said = Rotation.from_euler("XYZ", np.array(data["pose"])[:, 3:], degrees=True).as_matrix()
    np.testing.assert_allclose(said, turned, atol=5e-5)


def test_bars_and_joints_are_where_the_machine_is(shown, page):
    """The ends of the cylinders against the axes' coordinates and the pose of the trajectory
    itself.
    """
    recording, t = Recording(page), np.linspace(0, shown.trajectory.duration, 240)
    state, machine = shown.trajectory.at(t), shown.machine
    places = [
        recording.series("/machine/bars", f"batched_{what}")
        for what in ("positions", "wxyzs", "scales")
    ]
    shapes = ((240, -1, 3), (240, -1, 4), (240, -1, 3))
    centres, turns, scales = (
        at_frames(*series, t).reshape(shape).astype(float)
        for series, shape in zip(places, shapes, strict=True)
    )
    w, x, y, z = np.moveaxis(turns, 2, 0)
    along = np.stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], -1
    )  # R ẑ
    start, end = centres - along * scales[..., 2:] / 2, centres + along * scales[..., 2:] / 2
    joints = at_frames(*recording.series("/machine/joints", "batched_positions"), t).reshape(
        240, -1, 3
    )
    near = 1e-6 * max(1.0, float(abs(centres).max()))  # single precision
    np.testing.assert_allclose(joints[:, -1], state.pose.translation, atol=near)  # the tool
    if hasattr(machine, "legs") and machine.legs:
        for n in range(machine.legs):  # a rod and its tube for each, one after the other
            np.testing.assert_allclose(scales[:, 2 * n, 2], state.q[:, n], atol=near)
            np.testing.assert_allclose(
                start[:, 2 * n], np.tile(machine.base[n], (240, 1)), atol=near
            )
            np.testing.assert_allclose(
                end[:, 2 * n], state.pose.apply(machine.platform[n]), atol=near
            )
            np.testing.assert_allclose(start[:, 2 * n + 1], start[:, 2 * n], atol=near)
            assert (
                scales[:, 2 * n + 1, 2].max() < scales[:, 2 * n, 2].min()
            )  # the tube never hides all of the rod
    elif machine.name == "linkage":
        np.testing.assert_allclose(scales[:, [0, 2], 2], state.q, atol=near)
    else:
        np.testing.assert_allclose(np.linalg.norm(end - start, axis=2), scales[..., 2], atol=near)
        assert np.ptp(scales[..., 2], axis=0).max() < near  # links and rails keep their lengths


def test_no_mesh_is_sent_twice(page):
    kinds = [m["type"] for _, m in Recording(page).messages]
    assert kinds.count("BatchedMeshesMessage") == 2
    assert not {"MeshMessage", "GlbMessage", "RunJavascriptMessage"} & set(kinds)


def test_bars_have_the_colours_of_their_axes_limits(circle):
    """Order 3: the largest of |q̇|/max, |q̈|/max and |q⃛|/max, of travel and of the distances of
    the legs, by hand.
    """
    t = even_instants(circle.trajectory, 60)
    frames = compute_frames(circle, t)
    state, machine = circle.trajectory.at(t), circle.machine
    axes = machine.axes
    shares = {
        "speed": abs(state.qd) / [axis.max_speed for axis in axes],
        "acceleration": abs(state.qdd) / [axis.max_acceleration for axis in axes],
        "jerk": abs(state.qddd) / [axis.max_jerk for axis in axes],
    }
    low, high = np.array([axis.travel for axis in axes]).T
    shares["travel"] = abs(state.q - machine.home_q - (low + high) / 2) / ((high - low) / 2)
    bodies = machine.bodies
    uses = bodies.contact / bodies.distances(to_numbers(state.pose))
    pairs = [[k for k, name in enumerate(bodies.names) if axis.name in name] for axis in axes]
    shares["clearance"] = np.stack([uses[:, some].max(1) for some in pairs], 1)
    most = np.max(list(shares.values()), axis=0)
    np.testing.assert_allclose(frames.nearest.use[:, :6], most, atol=1e-9)
    for name, share in shares.items():
        at = frames.nearest.which[:, :6] == frames.nearest.limits.index(name)
        np.testing.assert_allclose(share[at], most[at], atol=1e-9)
    recording = Recording(document(circle, 60))
    colours = at_frames(*recording.series("/machine/bars", "batched_colors", np.uint8), t).reshape(
        60, -1, 3
    )
    np.testing.assert_array_equal(colours[:, 0:12:2], colour_uses(frames.nearest.use[:, :6]))
    np.testing.assert_array_equal(colours[:, 1:12:2], colour_uses(frames.nearest.use[:, :6]))
    assert (colours[:, 12:] == parse_colour("#3C464E")).all()  # what no axis moves


def test_joints_have_the_colours_of_their_tilt(circle):
    t = even_instants(circle.trajectory, 60)
    state, machine = circle.trajectory.at(t), circle.machine
    legs = np.stack([pose.apply(machine.platform) - machine.base for pose in state.pose])
    legs /= np.linalg.norm(legs, axis=2, keepdims=True)
    below = np.arccos(np.einsum("tlk,lk->tl", legs, machine.base_rest))
    rests = np.einsum("tkm,lm->tlk", state.pose.rotation.as_matrix(), machine.platform_rest)
    above = np.arccos(np.einsum("tlk,tlk->tl", legs, rests))
    tilt = np.concatenate([below, above], 1) / machine.max_tilt
    np.testing.assert_allclose(compute_frames(circle, t).tilt, tilt, atol=1e-9)
    recording = Recording(document(circle, 60))
    colours = at_frames(
        *recording.series("/machine/joints", "batched_colors", np.uint8), t
    ).reshape(60, -1, 3)
    assert (abs(colours[:, :12].astype(int) - colour_uses(tilt)) <= 1).all()  # rounding


def test_no_frame_uses_more_than_is_proved(shown):
    """Nor less: over many frames the nearest limit comes up to what the certificate met."""
    t = even_instants(shown.trajectory, 400)
    state = shown.trajectory.at(t)
    found = nearest(shown.limits, state, [axis.name for axis in shown.machine.axes])
    tilts = tilt_use(shown.limits, state, [pivot.name for pivot in shown.machine.parts.pivots])
    worst = shown.certificate.worst
    for n, name in enumerate(found.limits):
        of = found.use[found.which == n]
        assert of.size == 0 or of.max() <= worst[name] + 1e-9
    if "tilt" in worst:
        assert worst["tilt"] * 0.99 < np.nanmax(tilts) <= worst["tilt"] + 1e-9
    largest = max(value for name, value in worst.items() if name != "tilt")
    assert 0.99 * largest < found.use.max() <= largest + 1e-9


def test_the_ramp_runs_from_no_use_to_the_limit_and_darkens():
    for place, colour in RAMP:
        assert tuple(colour_uses(np.array(place))) == parse_colour(colour)
    assert tuple(colour_uses(np.array(1.2))) == parse_colour(RAMP[-1][1])
    assert tuple(colour_uses(np.array(np.nan))) == parse_colour("#3C464E")
    light = [np.dot(parse_colour(colour), [0.2126, 0.7152, 0.0722]) for _, colour in RAMP]
    assert light[-1] < min(light[:-1])


def test_paths_are_the_planned_one_and_that_of_the_pulses(shown):
    frames = compute_frames(shown, even_instants(shown.trajectory, 2))
    along = np.linspace(0, shown.trajectory.duration, len(frames.planned))
    np.testing.assert_allclose(
        frames.planned, shown.trajectory.at(along).pose.translation, atol=1e-12
    )
    worst = shown.realised(stride=100_000)["position"].bound
    assert 0 < np.linalg.norm(frames.errors, axis=1).max() <= worst
    np.testing.assert_allclose(
        frames.realised - frames.planned, frames.magnified * frames.errors, atol=1e-12
    )
    true = compute_frames(shown, even_instants(shown.trajectory, 2), 1.0)
    np.testing.assert_array_equal(true.realised, true.planned + true.errors)


def test_a_tool_aside_is_joined_to_the_platform(circle, tmp_path):
    """From the platform's origin, which is the tool's without one, to the tool: 60 mm along the
    platform's own z.
    """
    file = tmp_path / "held.toml"
    text = 'schema = 1\nlength = "mm"\nangle = "deg"\ntool = { to = [0, 0, 60] }\n[[segment]]\n'
    file.write_text(text + "line = { to = [5, 0, 85], rotate = [2, 0, 0] }\n")
    held = plan(load_program(str(file)), circle.machine, order=2)
    t = even_instants(held.trajectory, 5)
    frames, pose = compute_frames(held, t), held.trajectory.at(t).pose
    assert len(frames.bars) == len(circle.machine.parts.bars) + 1 == frames.placed.bars.shape[1]
    assert frames.bars[-1].sort == "platform"
    np.testing.assert_allclose(frames.placed.bars[:, -1, 1], frames.tool, atol=1e-15)
    np.testing.assert_allclose(frames.placed.bars[:, -1, 1], pose.apply([0, 0, 0.06]), atol=1e-12)
    np.testing.assert_allclose(frames.placed.bars[:, -1, 0], pose.translation, atol=1e-12)
    assert len(four_views(held)) == 4
    assert len(compute_frames(circle, t).bars) == len(circle.machine.parts.bars)


def test_paths_of_long_motions_are_drawn_at_more_instants(tmp_path):
    """Small circles one after the other: no chord leaves them by more than 1 % of their radius."""
    file = tmp_path / "round.toml"
    turns = "[[segment]]\narc = { centre = [0, 0, 0], normal = [0, 0, 1], angle = 21600 }\n"
    file.write_text('schema = 1\nlength = "mm"\nangle = "deg"\nstart = [6, 0, 0]\n' + turns)
    round_ = plan(load_program(str(file)), load_machine("linkage"), order=2)
    assert 12 < round_.trajectory.duration < 60
    frames = compute_frames(round_, even_instants(round_.trajectory, 240))
    middle = (frames.planned[1:] + frames.planned[:-1]) / 2
    home = load_machine("linkage").home.translation
    radius = np.linalg.norm(middle - home, axis=1)
    assert radius.min() > 0.99 * 0.006
    assert [count_instants(seconds) for seconds in (0.5, 12.0, 20.0, 3600.0)] == [
        MIN_PATH_INSTANTS,
        MIN_PATH_INSTANTS,
        2000,
        MAX_PATH_INSTANTS,
    ]
    assert len(document(round_).encode()) <= SIZE


def test_errors_are_magnified_by_round_numbers_and_never_made_less():
    planned = np.array([[0, 0, 0], [0.1, 0, 0]])
    for error, factor in [(1e-6, 1000.0), (3.9e-6, 200.0), (1.0, 1.0), (0.0, 1.0)]:
        errors = np.array([[0, error, 0]])
        assert magnification(planned, errors) == factor
        assert factor == 1.0 or factor * error <= DRAWN_ERROR_SHARE * 0.1 * (1 + 1e-12)
    # to and fro 60 times, ten times as long as a path may be: a tenth
    assert magnification(np.tile(planned, (30, 1)), np.array([[0, 1e-6, 0]])) == 100.0
    assert magnification(planned, None) == 1.0


def test_the_page_says_what_it_draws(shown, page):
    frames = compute_frames(shown, even_instants(shown.trajectory, 240))
    assert f"error magnified {frames.magnified:g} times" in page.replace("\n", " ")
    assert "at true scale" in document(shown, 2, 1.0)
    data = json.loads(
        re.search(r'<script type="application/json" id="frames">(.*?)</script>', page, re.S).group(
            1
        )
    )
    assert [view["name"] for view in data["views"]] == ["top", "front", "side", "3-D"]
    assert data["rows"][: len(shown.machine.axes)] == [axis.name for axis in shown.machine.axes]
    assert set(data["names"]) >= {limit.name for limit in shown.limits}
    near = np.array(data["near"])
    np.testing.assert_allclose(
        near[:, : len(frames.nearest.owners), 1], 1e3 * frames.nearest.use, atol=0.5 + 1e-6
    )
    assert data["first"] == ("top" if shown.machine.name == "linkage" else "3-D")


def test_of_a_shaped_plan_it_says_which_path_is_behind_the_shapers(tmp_path):
    machine = load_machine("cartesian")
    machine = machine.driven_by(
        [replace(axis, shaper=Shaper("zv", 25.0, 0.05)) for axis in machine.axes]
    )
    made = plan(
        Program([Line(np.array([0.02, 0.01, 0.0])), Line(np.zeros(3))], name="there and back"),
        machine,
    )
    frames = compute_frames(made, even_instants(made.trajectory, 2))
    text = " ".join(document(made, 2).split())
    assert frames.shaped
    assert "planned path, before the input shapers" in text
    told = f"path behind the input shapers, in whole pulses, distance from the planned path magnified {frames.magnified:g}"
    assert told in text or "in whole pulses, at true scale" in text
    assert "realised path (whole pulses)" not in text
    assert (
        np.linalg.norm(frames.errors, axis=1).max() <= made.shaped.deviation + 2e-5
    )  # and half a pulse of each axis
    file = save_four_views(made, tmp_path / "views.svg")
    assert "path of the pulses, behind the input shapers" in unescape(
        file.read_text(encoding="utf-8")
    )


def test_names_are_no_markup(circle):
    named = replace(circle, program=replace(circle.program, name="</script><b>"))
    assert "</script><b>" not in document(named, 2)


def test_names_are_no_formulas(circle, tmp_path):
    name = r"at $5$ or {\bad $x_{$"
    named = replace(circle, program=replace(circle.program, name=name))
    file = save_four_views(named, tmp_path / "views.svg")
    assert name in unescape(file.read_text(encoding="utf-8"))


def test_a_path_that_counts_do_not_tell_is_left_out(circle, monkeypatch):
    def lost(*_):
        raise MotionError("the counts stand for no pose")

    monkeypatch.setattr("benchmarks.animation.frames.find_reached_poses", lost)
    frames = compute_frames(circle, even_instants(circle.trajectory, 2))
    assert frames.realised is None
    assert "is not available" in document(circle, 2)
    assert len(four_views(circle)) == 4


def test_animate_replaces_nothing_unasked(circle, tmp_path):
    file = tmp_path / "way.html"
    assert animate(circle, file, frames=2) == file
    with pytest.raises(MotionError, match="exists"):
        animate(circle, file, frames=3)
    animate(circle, file, frames=3, force=True)
    assert len(Recording(file.read_text(encoding="utf-8")).of("SetPositionMessage")) >= 2
    for bad, told in [
        ({"frames": 1}, "from 2 to"),
        ({"frames": 10**6}, "from 2 to"),
        ({"magnify": 0.0}, "above 0"),
    ]:
        with pytest.raises(MotionError, match=told):
            animate(circle, tmp_path / "other.html", **bad)
    assert [entry.name for entry in tmp_path.iterdir()] == ["way.html"]


def test_making_a_page_says_nothing_on_stdout(circle, capsys):
    document(circle, 2)
    assert capsys.readouterr().out == ""


def test_stills_are_four_axes_with_equal_scales(shown):
    axes = four_views(shown)
    assert (
        [ax.get_title() for ax in axes]
        == [view.name for view in VIEWS]
        == ["top", "front", "side", "3-D"]
    )
    assert len({ax.get_figure(root=True) for ax in axes}) == 1
    figure = axes[0].get_figure(root=True)
    figure.draw_without_rendering()
    for ax in axes[:3]:
        assert ax.get_aspect() == 1.0
        wide, high = np.diff(ax.get_xlim())[0], np.diff(ax.get_ylim())[0]
        box = ax.get_window_extent()
        assert box.width / wide == pytest.approx(box.height / high, rel=1e-6)
    limits = [np.diff(getattr(axes[3], f"get_{way}lim3d")())[0] for way in "xyz"]
    np.testing.assert_allclose(
        limits / max(limits), axes[3]._box_aspect / max(axes[3]._box_aspect), rtol=1e-6
    )
    assert [ax.get_xlabel()[0] + ax.get_ylabel()[0] for ax in axes[:3]] == ["xy", "xz", "yz"]


@pytest.mark.parametrize("scale", [1e-4, 1.0])
def test_a_flat_machine_is_flat_in_space_whatever_its_size(scale, tmp_path):
    """The linkage, and one of 40 µm: every quantity of its file that has mm in it, times the
    scale.
    """
    preset = files("kinematics") / "presets" / "linkage.toml"
    text = re.sub(
        r'"(-?[\d.]+) mm',
        lambda found: f'"{scale * float(found[1]):.9g} mm',
        preset.read_text("utf-8"),
    )
    machine, program = tmp_path / "flat.toml", tmp_path / "way.toml"
    machine.write_text(text, encoding="utf-8")
    program.write_text(
        f'schema = 1\nlength = "mm"\n[[segment]]\nline = {{ to = [{40 * scale}, 0, 0] }}\n'
    )
    space = four_views(plan(load_program(str(program)), load_machine(str(machine)), order=2))[3]
    wide, deep, high = (np.diff(getattr(space, f"get_{way}lim3d")())[0] for way in "xyz")
    assert 0 < high < 0.01 * min(wide, deep)


def test_stills_show_the_instant_asked_for(circle):
    t = 0.3
    for ax, of in zip(four_views(circle, t), ((0, 1), (0, 2), (1, 2)), strict=False):
        tool = 1e3 * circle.trajectory.at(t).pose.translation[0]
        spots = np.concatenate([collection.get_offsets() for collection in ax.collections])
        assert np.linalg.norm(spots - tool[list(of)], axis=1).min() < 1e-9
    for bad in (-0.1, circle.trajectory.duration + 0.1, np.nan):
        with pytest.raises(MotionError, match="is not within the motion"):
            four_views(circle, bad)


def test_stills_are_saved_as_their_names_say(circle, tmp_path):
    for suffix, begins in ((".PDF", b"%PDF"), (".png", b"\x89PNG")):
        file = save_four_views(circle, tmp_path / f"views{suffix}", 0.3)
        assert file.read_bytes().startswith(begins)
    with pytest.raises(MotionError, match="exists"):
        save_four_views(circle, file)
    with pytest.raises(MotionError, match=r"\.pdf, \.png, \.svg"):
        save_four_views(circle, tmp_path / "views.gif")


# No name resolves, should anything ask for one.
ALONE = ("--window-size=320,200", "--host-resolver-rules=MAP * ~NOTFOUND")


def open_page(folder, page):
    """What a browser makes of a page: its document, what is said on the console, and who asked the
    network.
    """
    log = folder / "net.json"
    done = browse(
        folder, page, *ALONE, f"--log-net-log={log}", "--virtual-time-budget=100", "--dump-dom"
    )
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    askers = set(re.findall(r'"initiator":"([^"]*)"', log.read_text(errors="replace")))
    return done.stdout, said, askers - {"not an origin"}  # the browser itself, for its own ends


@needs_browser
def test_a_browser_shows_it_and_asks_no_network(circle, tmp_path):
    shown, said, askers = open_page(tmp_path, animate(circle, tmp_path / "way.html", frames=12))
    assert all(
        "GL Driver Message" in line for line in said
    )  # viser's client would say much, and the browser may
    assert not [line for line in said if re.search("ERROR|Uncaught|Refused|violates", line)]
    assert re.search(r'<p id="when">\d\.\d{3} s of 1\.262 s</p>', shown)
    # the numbers of one of its frames stand in the page: that of the time which it shows
    data = told_by(shown)
    (when,) = re.findall(r'<p id="when">(\d\.\d{3}) s', shown)
    k = [f"{t:.3f}" for t in data["t"]].index(when)
    places = re.findall(r"<span>(-?[\d.]+ mm|-?[\d.]+°)</span>", shown)
    assert places == [
        f"{value:.3f}{' mm' if n < 3 else '°'}" for n, value in enumerate(data["pose"][k])
    ]
    lengths = re.findall(r"leg\d</td><td>([\d.]+) mm</td>", shown)
    assert lengths == [f"{value:.3f}" for value in data["q"][k]]
    assert askers == set()


@needs_browser
def test_that_test_would_see_a_request_and_what_the_policy_forbids(circle, tmp_path):
    ask = '<script>fetch("http://127.0.0.1:9/x").catch(() => 0)</script>'
    file = tmp_path / "way.html"
    file.write_text(f"<html><body>{ask}</body></html>")
    assert open_page(tmp_path, file)[2] == {"null"}
    shutil.rmtree(tmp_path / "profile")
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    assert f"<head>{policy}" in document(circle, 2)  # before all that it is to hold
    assert document(circle, 2).count(DARK[1]) == 1  # it takes the place of viser's own
    file.write_text(f"<html><head>{policy}</head><body>{ask}</body></html>")
    _, said, askers = open_page(tmp_path, file)
    assert askers == set()
    assert [line for line in said if "violates" in line]


class Bare(Machine):
    """Three slides that nothing is drawn of."""

    freedom, sorts, characteristic_length = ("x", "y", "z"), ("linear",) * 3, 0.1

    def __init__(self):
        axes = [
            Axis(name, travel=(-0.1, 0.1), max_speed=0.1, max_acceleration=1.0) for name in "xyz"
        ]
        super().__init__("bare", axes, [0, 0, 0.1])

    def expression(self, position, rotation, near):
        return position


@pytest.mark.parametrize("tool", [None, [0, 0, 0.01, 0.5, 0, 0]])
def test_a_machine_without_a_skeleton_is_drawn_by_its_tool(tool, tmp_path):
    """Its three axes, at its place and orthogonal, in pictures and in the recorded page."""
    start = [0.0, 0.0, 0.0] if tool is None else tool
    made = plan(Program([Line([0.02, 0, start[2]])], start=start, tool=tool), Bare())
    t = np.array([0.0, made.trajectory.duration])
    frames = compute_frames(made, t)
    if tool is None:
        ways = np.diff(frames.placed.bars, axis=2)[:, :, 0]
        np.testing.assert_allclose(
            frames.placed.bars[:, :, 0], np.repeat(frames.tool[:, None], 3, 1)
        )
        np.testing.assert_allclose(
            ways @ ways.swapaxes(1, 2),
            np.tile((0.15 * 0.02) ** 2 * np.eye(3), (2, 1, 1)),
            atol=1e-18,
        )
    assert len(frames.bars) == (3 if tool is None else 1)  # its shank shows where it is
    assert save_four_views(made, tmp_path / "bare.png").stat().st_size > 0
    animate(made, tmp_path / "bare.html")
    assert (tmp_path / "bare.html").stat().st_size > 0
    assert made.machine.plot()._repr_png_()
    assert made.plot()._repr_png_()
