"""A tenth of `python -m benchmarks.evidence pulse_trials --pulses 1e7`: random machines and programs, no pulse wrong."""

from benchmarks.evidence.cases.pulse_trials import run_trials


def test_a_million_pulses_of_random_machines_and_programs_hold():
    trials = list(run_trials(1e6, 0))
    assert sum(pulses for _, _, pulses, _ in trials) >= 1e6
    assert [fault for *_, fault in trials if fault] == []
    assert {machine for machine, *_ in trials} == {"Hexapod", "Tripod", "Traverser"}
