"""`python -m benchmarks.evidence NAME`: see benchmarks/evidence/run.py."""

from benchmarks.evidence.run import main

main()
