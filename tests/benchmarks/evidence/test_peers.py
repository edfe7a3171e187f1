"""Outside suites in small: what is read of them, made by their rules, and held against their answers."""

import numpy as np
import pytest

from benchmarks.evidence.peers import franka, random_splines, toppra_suite
from benchmarks.evidence.peers.franka import ArmTest
from benchmarks.evidence.peers.random_splines import Suite, chacha_numbers, summarize
from benchmarks.evidence.peers.ruckig_targets import compare_general, compare_moves, compare_targets, read_targets
from benchmarks.evidence.peers.toppra_suite import read_problems, read_record

# Of the shape of COPP's tests/test_random_spline.rs.
SPLINES = """
fn test_topp() {
    let config = TestConfig {
        dim: 3,
        num_waypoints: 6,
        s_len: 1001,
        velocity_max: 1.0,
        acceleration_max: 5.0,
        jerk_max: 50.0,
        seed: 7,
        n_exp: 2,
    };
"""
# Of the shape of toppra's problem_suite_1.yaml, and of what stands beside it.
PROBLEMS = """
there_and_back:
  waypoints: [[0, 0], [0, 2e-6], [0, 0]]
  ss_waypoints: [0, 1]
  nb_gridpoints: [51, 101]
  vlim: [100, 1000]
  alim: [100, 1000]
  desired_duration: [0, 1.0]
  solver_wrapper: ['hotqpoases', 'seidel']
"""
RECORD = """,status,duration,desired_duration,name,solver_wrapper,nb_gridpoints
0,FAIL,,0.0,there_and_back,hotqpoases,51
1,SUCCESS,0.5,0.0,there_and_back,hotqpoases,101
"""
# Of the shape of ruckig's test/test_target.cpp; a cube's root of 32 and 4 are the exact durations.
TARGETS = """
TEST_CASE("trajectory") {
    InputParameter<1> input;
    input.current_position = {0.0};
    input.target_position = {1.0};
    input.max_velocity = {1.0};
    input.max_acceleration = {1.0};
    input.max_jerk = {1.0};
    CHECK( traj.get_duration() == doctest::Approx(3.1748021039) );
    input.current_velocity = {0.3};
    CHECK( traj.get_duration() == doctest::Approx(1.0) );
TEST_CASE("phase") {
    InputParameter<3> input;
    input.current_position = {0.0, -2.0, 0.0};
    input.target_position = {10.0, -3.0, 2.0};
    input.max_velocity = {10.0, 2.0, 1.0};
    input.max_acceleration = {10.0, 2.0, 1.0};
    input.max_jerk = {10.0, 2.0, 1.0};
    CHECK( output.trajectory.get_duration() == doctest::Approx(4.0) );
"""


def test_chacha_is_that_of_rust():
    """First numbers of `StdRng::seed_from_u64(20260414)`; with them COPP's mean order-2 duration is found to 1e-6 s."""
    assert chacha_numbers(20260414, 5) == pytest.approx(
        [0.00758292, 0.64121419, 0.65376199, 0.58787359, 0.77813972], abs=1e-8
    )
    assert (chacha_numbers(5, 24)[:9] == chacha_numbers(5, 9)).all()


def test_random_splines_stand_at_their_ends_and_are_faster_than_theirs(tmp_path):
    """The certified motion keeps its limits; copp-py's, slowed until it does, is longer on 50 waypoints."""
    file = tmp_path / "test_random_spline.rs"
    file.write_text(SPLINES)
    assert Suite.read(file) == Suite(3, 6, (1.0, 5.0, 50.0), 7, 2)
    path, bounds = next(Suite.read(file).problems())
    assert np.abs([path(end, nu) for end in (0.0, 1.0) for nu in (1, 2)]).max() < 1e-9
    assert bounds.shape == (3, 2, 3)
    assert (np.abs(bounds / np.array([1.0, 5.0, 50.0])[:, None, None] - 1) < 0.1).all()
    found = random_splines.compare(Suite(count=1))
    ours = found["ours, order 3, certified"]
    assert max(ours[0].worst) < 1 + 1e-6
    if "copp-py TOPP3-SOCP, 1 linearisation" in found:
        assert ours[0].feasible < found["copp-py TOPP3-SOCP, 1 linearisation"][0].feasible
    assert summarize(ours)[1] == "1 of 1"


def test_a_suite_of_hard_problems_is_solved(tmp_path):
    """There and back: 2 √(L/A) each way; toppra's own record stands beside."""
    file = tmp_path / "suite.yaml"
    file.write_text(PROBLEMS)
    (tmp_path / toppra_suite.RECORD).write_text(RECORD)
    record = read_record(tmp_path / toppra_suite.RECORD)
    assert read_record(file.with_name("none")) == {}
    least, stated = toppra_suite.compare(read_problems(file), record)
    assert float(least["ours (s)"]) == pytest.approx(4 * np.sqrt(2e-6 / 1000), abs=2e-9)
    assert float(least["largest use"]) == pytest.approx(1.0, abs=1e-6)
    assert float(stated["ours (s)"]) == pytest.approx(1.0, abs=1e-9)
    assert least["recorded by toppra (s)"] == "0.500000000, hotqpoases"
    assert stated["recorded by toppra (s)"] == ""


def arm_test(seed=0):
    """Links with a mass about somewhere, in the form of COPP's tests/test_franka.rs."""
    rng = np.random.default_rng(seed)
    links = np.zeros((7, 12))
    for link in links:
        mass, centre, turned = rng.uniform(0.5, 2.0), rng.normal(0, 0.1, 3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = turned @ np.diag(mass * rng.uniform(0.005, 0.006, 3)) @ turned.T
        inertia += mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        link[:6], link[6:9], link[9] = inertia[np.triu_indices(3)], mass * centre, mass
        link[10:] = rng.uniform(0.1, 0.3, 2)
    numbers = ", ".join(f"({k}, {value!r})" for k, value in enumerate(links.ravel().tolist()))
    rows = ", ".join(f"{row}" for row in rng.uniform(-0.7, 0.7, (3, 7)).tolist())
    limits = {"V": [4.0] * 7, "A": [40.0] * 7, "J": [2000.0] * 7, "T": [60.0, 60.0, 40.0, 40.0, 8.0, 8.0, 8.0]}
    stated = "".join(f"const {name}MAX: [f64; FRANKA_DOF] = {values};\n" for name, values in limits.items())
    return (
        f"const FRANKA_NONZERO_PARAMS: &[(usize, f64)] = &[{numbers}];\n{stated}"
        f"let waypoints: &[[f64; FRANKA_DOF]] = &[{rows}];\n"
    )


def test_an_arm_keeps_its_torques(tmp_path):
    """The torques are pinocchio's of the same links; where they bind the motion is slower, and certified."""
    import pinocchio as pin

    file = tmp_path / "test_franka.rs"
    file.write_text(arm_test())
    test = ArmTest.read(file)
    model, parent = pin.Model(), 0
    for k, (along, lift, twist) in enumerate(franka.FRAMES):
        turned = pin.SE3(pin.utils.rotate("x", twist), np.zeros(3))
        placed = pin.SE3(np.eye(3), np.array([along, 0, 0])) * turned * pin.SE3(np.eye(3), np.array([0, 0, lift]))
        parent = model.addJoint(parent, pin.JointModelRZ(), placed, f"joint{k}")
        (xx, xy, xz, yy, yz, zz), centre, mass = (
            test.links[k, :6],
            test.links[k, 6:9] / test.links[k, 9],
            test.links[k, 9],
        )
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about -= mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        model.appendBodyToJoint(parent, pin.Inertia(mass, centre, about), pin.SE3.Identity())
    data, x = model.createData(), np.random.default_rng(1).normal(size=(5, 21))
    theirs = [pin.rnea(model, data, *one.reshape(3, 7)) for one in x]
    assert test.torques(x) - test.links[:, 11] == pytest.approx(np.array(theirs), rel=1e-9, abs=1e-9)
    bounded, free = (franka.solve_ours(test, bounded=bounded) for bounded in (True, False))
    assert bounded[0] == "ours, certified"
    assert float(free[6]) > 1.05
    assert 0.99 < float(bounded[6]) <= 1
    assert float(bounded[2]) > float(free[2])


def test_straight_moves_take_the_time_that_ruckig_finds(tmp_path):
    """The closed form to the 1e-9 that it stays below the limits; a refusal where ruckig has to move backwards."""
    file = tmp_path / "test_target.cpp"
    file.write_text(TARGETS)
    assert [expected for _, _, expected in read_targets(file)] == [3.1748021039, 4.0]
    assert abs(compare_targets(file).largest) < 1e-9
    pytest.importorskip("ruckig")
    rest, moving = (compare_moves(12, between_speeds=between_speeds) for between_speeds in (False, True))
    assert rest.faults == moving.faults == []
    assert moving.refused == moving.turning > 0
    assert max(abs(rest.largest), abs(moving.largest)) < 1.1e-9
    assert 0 < compare_general(2).largest < 1e-3
