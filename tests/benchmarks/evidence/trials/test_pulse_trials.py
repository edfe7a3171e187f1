"""A tenth of `python -m benchmarks.evidence.trials.pulse_trials --pulses 1e7`: random machines and programs, not one
pulse wrong."""

from benchmarks.evidence.trials.pulse_trials import run_trials


def test_a_million_pulses_of_random_machines_and_programs_hold():
    made = list(run_trials(1e6))
    assert sum(one.pulses for one in made) >= 1e6
    assert [(one.seed, one.faults) for one in made if one.faults] == []
    assert [(one.seed, one.refused) for one in made if one.refused] == []
    assert {one.machine for one in made} == {"Hexapod", "Tripod", "Traverser"}
