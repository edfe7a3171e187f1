"""A tenth of the case `pulse_trials` with 1e7 pulses: random machines and programs, no pulse at
fault.
"""

from benchmarks.evidence.cases.pulse_trials import run_trials


def test_a_million_pulses_of_random_machines_and_programs_hold():
    trials = list(run_trials(1e6))
    assert sum(pulses for _, _, pulses, _ in trials) >= 1e6
    assert [fault for *_, fault in trials if fault] == []
    assert {machine for machine, *_ in trials} == {"Hexapod", "Tripod", "Traverser"}
