"""The budget against Monte Carlo through forward kinematics, against vertices, and against closed
forms.
"""

from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Backlash,
    Hexapod,
    LeadError,
    Linkage,
    Machine,
    MotionError,
    OutOfReach,
    PulseLength,
    Quantization,
    Temperature,
    Traverser,
    error_budget,
    load_machine,
)

SAMPLES = 10_000
SEVERAL = [
    Quantization(),
    PulseLength(50e-6, common=True),
    Backlash(4e-6),
    LeadError(rate=30e-6, periodic=2e-6),
    Temperature(ambient=3.0, heating=2.0, frame_expansion=23e-6),
]


def tilted(machine, shift=(0.008, -0.005, 0.025), turn=(0.08, -0.06, 0.1)):
    moved = Rotation.from_rotvec(turn) * machine.home.rotation
    return RigidTransform.from_components(machine.home.translation + shift, moved)


def difference(found, pose):
    """[dx, dy, dz, turn] in the base frame from one pose to others, (N, 6)."""
    turn = (found.rotation * pose.rotation.inv()).as_rotvec()
    return np.concatenate([found.translation - pose.translation, np.atleast_2d(turn)], 1)


def drawn(source, random, count, q, machine):
    """Errors (count, n) of the axes: each source as its own words have it, not by way of the
    budget's algebra.
    """
    n, travel = len(q), q - machine.home_q
    pulse = np.array([axis.pulse for axis in machine.axes])
    match source:
        case Quantization():
            # what pulses do: targets anywhere about q, each rounded to the nearest whole pulse
            target = q + random.uniform(-50, 50, (count, n)) * pulse
            return np.round((target - machine.home_q) / pulse) * pulse - (target - machine.home_q)
        case PulseLength(common=True):
            return random.uniform(-1, 1, (count, 1)) * source.error * travel
        case PulseLength():
            return random.uniform(-1, 1, (count, n)) * source.error * travel
        case Backlash():
            return random.choice([-0.5, 0.5], (count, n)) * source.width
        case LeadError():
            phase = random.uniform(0, 2 * np.pi, (count, n))
            return random.uniform(
                -1, 1, (count, n)
            ) * source.rate * travel + source.periodic * np.sin(phase)


@pytest.mark.parametrize("source", [*SEVERAL[:4], PulseLength(50e-6)], ids=repr)
def test_covariance_and_bound_hold_in_monte_carlo_through_forward(preset, source):
    """Variance of a sample variance: at most 2/N of its square, so 6 % is four standard deviations
    at 10 000.
    """
    pose = tilted(preset)
    q = preset.inverse(pose)
    found = error_budget(preset, pose, [source]).total
    errors = drawn(source, np.random.default_rng(1), SAMPLES, q, preset)
    seen = difference(preset.forward(q + errors, near=pose).pose, pose)
    scale = np.outer(found.sigma[0], found.sigma[0])
    assert np.cov(seen.T) / scale == pytest.approx(found.covariance[0] / scale, abs=0.06)
    # first order: the bound holds up to the square of errors of micrometres
    assert (np.abs(seen) <= found.spread * (1 + 1e-3)).all()
    assert np.abs(seen.mean(0)) == pytest.approx(
        np.zeros(6), abs=5 * found.sigma.max() / np.sqrt(SAMPLES)
    )


def test_temperature_against_a_machine_that_has_really_grown(preset):
    """Build the machine larger, let its legs be longer than commanded, and ask where the platform
    stands.
    """
    pose, q = tilted(preset), preset.inverse(tilted(preset))
    expansion = {"axis_expansion": 11e-6, "frame_expansion": 23e-6}

    def grown(ambient, heating):
        frame = 1 + ambient * expansion["frame_expansion"]
        legs = 1 + (ambient + heating) * expansion["axis_expansion"]
        axes = [Axis(f"leg{k}") for k in range(6)]
        larger = Hexapod(preset.base * frame, preset.platform * frame, axes=axes, home=preset.home)
        return difference(larger.forward((q * legs)[None], near=pose).pose, pose)[0]

    for column, kelvin in enumerate(np.eye(2)):
        seen = (grown(*kelvin) - grown(*-kelvin)) / 2
        effect = Temperature(*kelvin, **expansion).effect(
            preset, RigidTransform.concatenate([pose]), q[None]
        )
        found = (np.linalg.inv(preset.jacobian(pose)) @ effect.axes[0] + effect.pose[0])[:, column]
        # 1 K is a relative change of 1e-5: what is of third order is below what the solver leaves
        assert seen == pytest.approx(found, rel=1e-6, abs=1e-12)


def test_a_machine_of_one_material_only_grows(preset):
    pose = tilted(preset)
    found = error_budget(preset, pose, [Temperature(ambient=2.0)]).total
    expected = 2.0 * 12e-6 * np.abs(pose.translation)
    assert found.spread[0] == pytest.approx([*expected, 0, 0, 0], rel=1e-12, abs=1e-18)


def test_first_order_is_exact_in_the_limit(preset):
    """The error that the budget neglects is of second order: halved errors leave a quarter of
    it.
    """
    pose = tilted(preset)
    q, inverse = preset.inverse(pose), np.linalg.inv(preset.jacobian(pose))
    direction = np.random.default_rng(2).uniform(-1, 1, 6)
    left = []
    for size in 1e-3 * 0.5 ** np.arange(6):
        seen = difference(preset.forward((q + size * direction)[None], near=pose).pose, pose)[0]
        left.append(np.linalg.norm(seen - inverse @ (size * direction)))
    rate = np.log2(np.array(left[:-1]) / left[1:])
    assert rate == pytest.approx(np.full(5, 2.0), abs=0.05)


def test_worst_case_is_attained_at_a_vertex_and_nowhere_beaten(any_hexapod):
    machine = any_hexapod
    size = 1e-3 * machine.characteristic_length
    pose = tilted(machine, shift=size * np.array([3.0, -2.0, 4.0]), turn=(0.01, -0.02, 0.015))
    worst = error_budget(machine, pose, [Quantization()]).total.worst[0]
    half = np.array([axis.pulse for axis in machine.axes]) / 2
    vertices = np.array(list(product([-1, 1], repeat=6))) * half
    linear = vertices @ np.linalg.inv(machine.jacobian(pose)).T
    assert worst == pytest.approx(np.abs(linear).max(0), rel=1e-12)
    inside = (
        np.random.default_rng(0).uniform(-1, 1, (1000, 6))
        * half
        @ np.linalg.inv(machine.jacobian(pose)).T
    )
    assert (np.abs(inside).max(0) <= worst).all()


def test_worst_case_vertex_through_forward(preset):
    """The same 2⁶ vertices by forward kinematics: the first order holds to the square of half a
    pulse.
    """
    pose = tilted(preset)
    worst = error_budget(preset, pose, [Quantization()]).total.worst[0]
    vertices = np.array(list(product([-1, 1], repeat=6))) * preset.axes[0].pulse / 2
    seen = np.abs(
        difference(preset.forward(preset.inverse(pose) + vertices, near=pose).pose, pose)
    ).max(0)
    assert seen == pytest.approx(worst, rel=1e-4)


def test_quantization_is_the_formula_of_the_literature(preset):
    """Σ = J⁻¹ (p²/12 I) J⁻ᵀ, worst case Σⱼ |J⁻¹ᵢⱼ| p/2."""
    pose, pulse = tilted(preset), preset.axes[0].pulse
    found, inverse = (
        error_budget(preset, pose, [Quantization()]).total,
        np.linalg.inv(preset.jacobian(pose)),
    )
    assert found.covariance[0] == pytest.approx(inverse @ inverse.T * pulse**2 / 12, rel=1e-12)
    assert found.worst[0] == pytest.approx(np.abs(inverse).sum(1) * pulse / 2, rel=1e-12)


def test_rounding_to_the_nearest_pulse_has_a_variance_of_a_twelfth():
    """Exactly: over m equally spaced targets within one pulse, the mean square of e is p²/12 (1 −
    1/m²).
    """
    m, pulse = 1000, 0.75e-6
    targets = (np.arange(m) + 0.5) / m * pulse
    error = np.round(targets / pulse) * pulse - targets
    assert (error**2).mean() == pytest.approx(pulse**2 / 12 * (1 - 1 / m**2), rel=1e-9)
    assert np.abs(error).max() <= pulse / 2


def test_total_is_the_sum_and_no_source_covers_another(preset):
    budget = error_budget(preset, tilted(preset), SEVERAL)
    assert budget.total.covariance == pytest.approx(
        sum(part.covariance for part in budget.contributions)
    )
    assert budget.total.worst == pytest.approx(sum(part.worst for part in budget.contributions))
    for part in budget.contributions:
        alone = error_budget(
            preset, tilted(preset), [next(s for s in SEVERAL if s.name == part.name)]
        ).total
        assert part.covariance == pytest.approx(alone.covariance)


def test_along_a_path_each_pose_has_its_own_budget(preset):
    heights = np.linspace(0.0, 0.04, 9)
    poses = RigidTransform.concatenate(
        [tilted(preset, shift=(0.01, 0, z), turn=(0.02, 0, 5 * z)) for z in heights]
    )
    path = error_budget(preset, poses, SEVERAL)
    assert len(path) == 9
    for k in (0, 4, 8):
        single = error_budget(preset, poses[k], SEVERAL).total
        assert path.total.covariance[k] == pytest.approx(single.covariance[0], rel=1e-12, abs=1e-30)
        assert path.total.worst[k] == pytest.approx(single.worst[0], rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 6), st.floats(0, 1e-5), st.floats(0, 1e-4), st.floats(0, 20))
def test_covariance_is_one_and_worst_covers_it(preset, place, backlash, rate, kelvin):
    """Symmetric, no negative eigenvalue, and nowhere more variance than errors within ±worst can
    have.
    """
    pose = tilted(preset, 0.01 * np.array(place[:3]) + [0, 0, 0.025], 0.1 * np.array(place[3:]))
    sources = [Quantization(), Backlash(backlash), LeadError(rate, backlash), Temperature(kelvin)]
    total = error_budget(preset, pose, sources).total
    scale = np.diag(1 / total.sigma[0])
    correlation = scale @ total.covariance[0] @ scale
    assert correlation == pytest.approx(correlation.T, abs=1e-12)
    assert np.linalg.eigvalsh(correlation).min() > -1e-12
    assert (total.sigma <= total.worst).all()


def test_error_at_the_tool_is_that_of_a_machine_whose_platform_is_there(preset):
    """Move the platform's frame to the tool: the same legs, another origin, the same budget."""
    tool, pose = np.array([0.03, -0.02, 0.08]), tilted(preset)
    to_tool = RigidTransform.from_translation(tool)
    same = Hexapod(
        preset.base, preset.platform - tool, axes=preset.axes, home=preset.home * to_tool
    )
    there = error_budget(same, pose * to_tool, SEVERAL[:4]).total
    asked = error_budget(preset, pose, SEVERAL[:4], tool=tool).total
    assert asked.covariance == pytest.approx(there.covariance, rel=1e-9, abs=1e-24)
    assert asked.worst == pytest.approx(there.worst, rel=1e-9)


class Winding(Machine):
    """Slides along x, y and z that are a little bent, and turn the platform about axes of their own
    as they go.
    """

    freedom, follows = ("x", "y", "z"), ("rx", "ry", "rz")
    characteristic_length = 0.1

    def expression(self, position, rotation, near):
        return position + ca.vertcat(position[1] ** 2, position[2] ** 2, position[0] ** 2)

    def fill_pose(self, position, rotation, q):
        turned = ca.SX.eye(3)
        for k, axis in enumerate(np.array([[0.6, 0.8, 0], [0, 0.6, 0.8], [0.8, 0, 0.6]])):
            skew = ca.skew(ca.DM(axis))
            turned = turned @ (
                ca.SX.eye(3) + ca.sin(5 * q[k]) * skew + (1 - ca.cos(5 * q[k])) * (skew @ skew)
            )
        return position, turned


def linkage():
    axes = [Axis("a", pulse=2e-6), Axis("b", pulse=3e-6)]
    return Linkage(
        [0, 0],
        [0.25, 0],
        0.06,
        0.7,
        axes=axes,
        home=RigidTransform.from_translation([0.12, 0.3, 0.0]),
    )


def winding():
    axes = [Axis(name, pulse=p) for name, p in zip("abc", (1e-6, 2e-6, 3e-6), strict=True)]
    return Winding("winding", axes, RigidTransform.identity())


@pytest.mark.parametrize("make", [linkage, winding])
def test_what_follows_gets_its_error_too(make):
    """Differences of the forward map at each vertex; those of ±1 have three times the variance of
    the uniform.
    """
    machine = make()
    pose = machine.forward(machine.home_q + [0.03, -0.02, 0.01][: len(machine.axes)]).pose
    q, found = machine.inverse(pose), error_budget(machine, pose, [Quantization()]).total
    half = np.array([axis.pulse for axis in machine.axes]) / 2
    vertices = np.array(list(product([-1, 1], repeat=len(half)))) * half
    seen = difference(machine.forward(q + vertices, near=pose).pose, pose)
    assert found.worst[0] == pytest.approx(np.abs(seen).max(0), rel=1e-4, abs=1e-15)
    size = np.abs(seen).max(0) + 1e-30
    assert found.covariance[0] / np.outer(size, size) == pytest.approx(
        seen.T @ seen / len(seen) / 3 / np.outer(size, size), abs=1e-4
    )
    moves = [
        name in machine.freedom + machine.follows for name in ("x", "y", "z", "rx", "ry", "rz")
    ]
    assert (found.worst[0] > 0).tolist() == moves


def test_rotary_and_linear_axes_together():
    """A traverser: slides and turntable err each on its own, so the covariance is diagonal, at any
    turn.
    """
    axes = [Axis(name, pulse=p) for name, p in zip("XYZ", (1e-5, 2e-5, 3e-5), strict=True)]
    machine = Traverser(
        axes=[*axes, Axis("R", "rotary", pulse=0.01)], home=RigidTransform.identity()
    )
    pose = RigidTransform.from_components([0.3, 0.2, 0.1], Rotation.from_rotvec([0, 0, 0.4]))
    found = error_budget(machine, pose, [Quantization()]).total
    assert found.sigma[0] * np.sqrt(12) == pytest.approx([1e-5, 2e-5, 3e-5, 0, 0, 0.01], rel=1e-9)
    # after three turns the pulses count from home: the error of a pulse's length has grown with
    # them
    turned = error_budget(machine, pose, [PulseLength(1e-4)], near=[0, 0, 0, 6 * np.pi]).total
    assert turned.worst[0, 5] == pytest.approx(1e-4 * (0.4 + 6 * np.pi))
    with pytest.raises(MotionError, match="linear and rotary axes: give one number"):
        error_budget(machine, pose, [Backlash(1e-5)])
    both = error_budget(machine, pose, [Backlash((1e-5, 1e-5, 1e-5, 2e-3))]).total
    assert both.worst[0] == pytest.approx([5e-6, 5e-6, 5e-6, 0, 0, 1e-3])


def test_table_names_every_source_and_unit(preset):
    text = str(error_budget(preset, tilted(preset), SEVERAL))
    for word in (
        "quantization",
        "backlash",
        "temperature",
        "total",
        "sigma",
        "worst",
        "x (µm)",
        "rz (µrad)",
    ):
        assert word in text


@pytest.mark.parametrize("count", [1, 5])
def test_figure_draws_every_source(preset, count):
    poses = RigidTransform.concatenate(
        [tilted(preset, shift=(0, 0, 0.005 * k)) for k in range(count)]
    )
    ax = error_budget(preset, poses, SEVERAL).plot()
    drawn_names = (
        [line.get_label() for line in ax.get_lines()]
        if count > 1
        else [t.get_text() for t in ax.get_yticklabels()]
    )
    assert drawn_names == [source.name for source in SEVERAL] + ["total"]
    assert "µm" in (ax.get_ylabel() if count > 1 else ax.get_xlabel())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Quantization(-0.5), "quantization: pulses -0.5"),
        (
            lambda: PulseLength(float("nan")),
            "pulse length: error must be finite numbers in SI units, not nan",
        ),
        (lambda: Backlash((1e-6, -1e-6)), "backlash: width"),
        (
            lambda: Temperature(ambient=float("inf")),
            "temperature: ambient must be finite numbers in SI units, not inf",
        ),
    ],
)
def test_bad_sources(wrong, message):
    with pytest.raises(MotionError, match=message):
        wrong()


def test_bad_requests(preset):
    pose = tilted(preset)
    with pytest.raises(MotionError, match="no sources"):
        error_budget(preset, pose, [])
    with pytest.raises(MotionError, match="2 numbers for the 6 axes"):
        error_budget(preset, pose, [Backlash((1e-6, 1e-6))])
    with pytest.raises(MotionError, match=r"tool must be finite numbers \(3,\) in m"):
        error_budget(preset, pose, [Quantization()], tool=[0, 0])
    with pytest.raises(MotionError, match="no poses"):
        error_budget(preset, RigidTransform.from_translation(np.zeros((0, 3))), [Quantization()])
    with pytest.raises(OutOfReach):
        error_budget(preset, RigidTransform.from_translation([0, 0, np.nan]), [Quantization()])


def test_a_singular_pose_is_refused(monkeypatch):
    """Similar hexagons in base and platform: level, such a hexapod is architecturally singular."""
    monkeypatch.setattr(
        "kinematics.kinds.legged._refuse_coincident", lambda *_: None
    )  # else it is no machine
    angle = np.deg2rad(60 * np.arange(6))
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(6)], 1)
    home = RigidTransform.from_translation([0, 0, 0.3])
    machine = Hexapod(0.2 * ring, 0.1 * ring, axes=[Axis(f"leg{k}") for k in range(6)], home=home)
    with pytest.raises(MotionError, match="is singular at the pose, position"):
        error_budget(machine, home, [Quantization()])


def test_backlash_is_the_axes_own_where_none_is_given(preset):
    """Half of its gap to each side, through the inverse Jacobian of one leg alone."""
    gap = 3e-6
    axes = [replace(axis, backlash=gap if n == 1 else 0.0) for n, axis in enumerate(preset.axes)]
    machine = Hexapod(preset.base, preset.platform, axes=axes, home=preset.home)
    (part,) = error_budget(machine, machine.home, [Backlash()]).contributions
    expected = np.abs(np.linalg.inv(machine.jacobian(machine.home))[:, 1]) * gap / 2
    np.testing.assert_allclose(part.worst[0], expected, rtol=1e-12)
    assert not error_budget(preset, preset.home, [Backlash()]).total.worst.any()


def test_the_worst_case_is_a_bound_as_it_is_read():
    hexapod = load_machine("hexapod")
    budget = error_budget(hexapod, hexapod.home, [Quantization()])
    (table,) = budget.tables()
    shown = {row[0] + row[1]: row[2:] for row in table.cells()}
    worst = 1e6 * budget.total.worst[0]
    assert all(
        0 <= float(text) - value < 1e-3
        for text, value in zip(shown["totalworst"], worst, strict=True)
    )
