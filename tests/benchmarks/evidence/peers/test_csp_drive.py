"""The emulated CiA 402 drive: the standard's transitions, the physics of its loops, and a plan played on it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evidence.peers.csp_drive import __main__ as bench
from benchmarks.evidence.peers.csp_drive.canopen_ import enable_by_canopen
from benchmarks.evidence.peers.csp_drive.drive import POSITION_GAIN, TICK, Drive, SdoError
from benchmarks.evidence.peers.csp_drive.master import play
from kinematics import load_machine
from planner import load_program, plan

TICKS = 16
"""Cycles of the drive in a cycle of 1 ms, which the object dictionary begins with."""
ENABLING = (0x06, 0x07, 0x0F)


def word_of(drive: Drive) -> int:
    """The bits of the statusword by which states are told apart, those that do not count as 0."""
    word = drive.read(0x6041)
    return word & (0x6F if word & 0x08 == 0 and word & 0x40 == 0 else 0x4F)


def enabled(*, at: float = 0.0, parabola: bool = False, rated: float = 0.0) -> Drive:
    drive = Drive(at, parabola=parabola, rated=rated)
    drive.write(0x6060, 8)
    for word in ENABLING:
        drive.write(0x6040, word)
    return drive


@pytest.mark.parametrize(
    ("words", "state"),
    [
        ((), 0x40),
        ((0x06,), 0x21),  # 2
        ((0x06, 0x07), 0x23),  # 3
        ((0x06, 0x07, 0x0F), 0x27),  # 4
        ((0x06, 0x0F), 0x27),  # 3 and 4
        ((0x06, 0x07, 0x0F, 0x07), 0x23),  # 5
        ((0x06, 0x07, 0x06), 0x21),  # 6
        ((0x06, 0x00), 0x40),  # 7
        ((0x06, 0x02), 0x40),  # 7
        ((0x06, 0x07, 0x0F, 0x06), 0x21),  # 8
        ((0x06, 0x07, 0x0F, 0x00), 0x40),  # 9
        ((0x06, 0x07, 0x02), 0x40),  # 10
        ((0x06, 0x07, 0x0F, 0x02), 0x07),  # 11
        ((0x06, 0x07, 0x0F, 0x0A), 0x07),  # 11, whatever bit 3 is
        ((0x06, 0x07, 0x0F, 0x02, 0x00), 0x40),  # 12
        ((0x06, 0x07, 0x0F, 0x02, 0x0F), 0x27),  # 16
        ((0x07,), 0x40),
        ((0x0F,), 0x40),
        ((0x80,), 0x40),
        ((0x06, 0x86), 0x21),  # bit 7 rises where there is no fault
    ],
)
def test_controlwords_lead_where_the_standard_says(words, state):
    drive = Drive()
    for word in words:
        drive.write(0x6040, word)
    assert word_of(drive) == state


def test_a_following_error_is_a_fault_that_a_rising_bit_resets():
    drive = enabled()
    drive.write(0x6065, 100)
    drive.write(0x6066, 5)
    drive.write(0x607A, 100_000)
    beyond = 0
    while word_of(drive) == 0x27:
        drive.run(TICKS)
        beyond += 1
    assert 5 < beyond <= 7  # ms: the time out, and where in the first cycle the window was left
    assert drive.read(0x603F) == 0x8611
    assert drive.read(0x6041) & 0x2000
    assert word_of(drive) == 0x0F
    for _ in range(200):
        drive.run(TICKS)
    assert word_of(drive) == 0x08
    stands = drive.read(0x6064)
    drive.write(0x6040, 0x0F)
    assert word_of(drive) == 0x08
    drive.write(0x6040, 0x80)
    assert word_of(drive) == 0x40
    for word in ENABLING:
        drive.write(0x6040, word)
    assert drive.read(0x6062) == stands  # enabled again it begins where the motor stands


def test_objects_refuse_what_they_do_not_hold():
    drive = Drive()
    for index, value, subindex, code in (
        (0x6041, 0, 0, 0x06010002),
        (0x607A, 1 << 31, 0, 0x06090030),
        (0x60B2, -(1 << 15) - 1, 0, 0x06090030),
        (0x6060, 1, 0, 0x06090030),
        (0x6099, 0, 0, 0x06020000),
        (0x607D, 0, 3, 0x06090011),
    ):
        with pytest.raises(SdoError) as caught:
            drive.write(index, value, subindex)
        assert caught.value.code == code
    drive.write(0x607A, -(1 << 31))
    assert drive.read(0x607A) == -(1 << 31)


@pytest.mark.parametrize("parabola", [True, False])
def test_between_rows_of_a_parabola_it_is_on_the_parabola_or_on_its_chords(parabola):
    """q = 12 n² + 5 n: chords are 24/8 increments off in the middle, the parabola of three rows is exact."""
    drive = enabled(parabola=parabola)
    way = []
    for n in range(10):
        drive.write(0x607A, 12 * n * n + 5 * n)
        way.append(drive.run(TICKS))
        assert drive.read(0x6062) == 12 * n * n + 5 * n
    n = np.arange(1, 9)[:, None] + np.arange(TICKS) / TICKS
    off = abs(np.array(way[2:]) - (12 * n**2 + 5 * n)).max()
    assert off == pytest.approx(0.0 if parabola else 24 / 8, abs=1e-9)


@pytest.mark.parametrize("helped", [True, False])
def test_at_even_speed_it_lags_by_speed_over_gain_without_the_velocity_offset(helped):
    drive, step = enabled(), 40
    for n in range(1000):
        drive.write(0x607A, n * step)
        drive.write(0x60B1, step * 1000 if helped and n else 0)
        drive.run(TICKS)
    lag = drive.demand - drive.motion[0]
    assert lag == pytest.approx(0.0 if helped else step * 1000 / POSITION_GAIN, abs=1.0)


def test_a_torque_offset_carries_the_load_before_the_loops_do():
    """300 of 1000 of what accelerates by 2·10⁶ increments/s², against a load of as much; without it the axis sags."""
    sag = []
    for offset in (300, 0):
        drive = enabled(rated=2e6)
        drive.write(0x60B2, offset)
        for _ in range(300):
            drive.run(TICKS, (-6e5, -6e5))
        sag.append(drive.motion[5])
        assert drive.read(0x6064) == 0  # the integral carries it in the end
    assert sag[0] < 0.1 * sag[1]  # it comes evenly over the first cycle
    assert sag[1] > 6e5 * TICK**2


def test_the_demand_stays_at_a_position_limit():
    drive = enabled()
    drive.write(0x607D, 100, 2)
    for n in range(20):
        drive.write(0x607A, 10 * n)
        drive.run(TICKS)
        assert drive.read(0x6062) == min(10 * n, 100)
        assert bool(drive.read(0x6041) & 0x800) == (n > 10)
        assert bool(drive.read(0x6041) & 0x1000) == (n <= 10)


@pytest.fixture(scope="module")
def case():
    program = load_program("linkage-line")
    made = plan(program, load_machine(program.machine))
    return bench.make_case("linkage-line", made, 1e-3)


def test_a_plan_is_demanded_row_by_row_within_what_the_export_states(case):
    for parabola, stated in ((False, case.straight), (True, case.parabola)):
        played = play(case.sheet, replace(case.setting, parabola=parabola))
        assert (played.demanded == case.sheet.rows).all()
        assert (played.actual == case.sheet.rows[-1]).all()
        assert abs(np.diff(played.demanded, 2, axis=0)).max() == case.difference <= case.sheet.most.max()
        assert 0.9 * stated < bench.measure_way(case, played) <= 1.005 * stated  # printed with three digits
        assert played.enabled
        assert not played.limited
        assert not played.errors
        without = play(case.sheet, replace(case.setting, parabola=parabola, offsets=()))
        speed = abs(np.diff(case.sheet.rows, axis=0)).max() / case.sheet.cycle
        assert played.following.max() < 0.02 * without.following.max()
        assert without.following.max() == pytest.approx(speed / POSITION_GAIN, rel=0.05)


def test_what_is_wrong_is_seen(case):
    _, window = bench.describe_case(case)
    seen = {fault: bench.find_signs(case, change, window) for fault, change in bench.FAULTS.items()}
    limited, faulted, off, unlike = bench.SEEN
    assert not seen["nothing"].total()
    for fault in ("a row is lost, where it is fastest", "a row is sent twice, there"):
        assert seen[fault][limited] == seen[fault][unlike] == 1
    assert seen["rows lead beyond 0x607D"][limited] == seen["rows lead beyond 0x607D"][unlike] == 1
    assert not seen["it stands half a window from `starts at`"][faulted]
    for fault in ("it stands two windows from there", "it is enabled while rows run"):
        assert seen[fault][faulted] == seen[fault][off] == 1
    assert seen["0x0F comes before 0x06 and 0x07"][off] == seen["0x6060 is not set"][unlike] == 1
    assert seen["0x60C2 is twice the cycle"][unlike] == 1


def test_forces_of_the_motion_are_carried_by_torque_offsets():
    """The bare circle on the hexapod with its masses: what is left with torque offsets is that of the motor alone."""
    program = load_program("bare-circle")
    loaded = bench.make_case("bare-circle", plan(program, load_machine(program.machine), order=2), 4e-3)
    assert "0x60B2" in loaded.sheet.columns
    full, less = (play(loaded.sheet, replace(loaded.setting, offsets=of)) for of in (("0x60B1", "0x60B2"), ("0x60B1",)))
    assert full.following.max() < 0.5 * less.following.max()


def test_somebody_elses_master_enables_it():
    pytest.importorskip("canopen")
    said = "\n".join(enable_by_canopen())
    assert "finds the drive in SWITCH ON DISABLED" in said
    assert "READY TO SWITCH ON, SWITCHED ON, OPERATION ENABLED" in said
    assert "FAULT REACTION ACTIVE, FAULT; after a reset OPERATION ENABLED" in said
    assert "QUICK STOP ACTIVE, SWITCH ON DISABLED" in said
    assert "0x6041 0x06010002, 0x6060 0x06090030, 0x6099 0x06020000" in said
