"""From a motion to pulses: firing rules, level crossings, spacing."""
