#!/usr/bin/env bash
# Re-arranges the house in a clean work tree: see README.md. Needs the development environment's python and ruff in PATH,
# and a Python of 3.12 or newer as PYTHON312 (positions inside f-strings are wrong before).
set -u
run() { cp "tests/house/$1.py.txt" "$work/$1.py"; shift_name=$1; shift; "${PY:-python}" "$work/$shift_name.py" "$@"; }
work=$(mktemp -d)
tidy() {
  git add -A
  ruff check -q --fix --select I,F401,F811,PIE790,RUF022,UP037 . >/dev/null
  sed -i 's/^from planner.limits import Limit, limits_of/from planner.limits import limits_of/' planner/baselines/classical.py
  ruff format -q .
  git add -A
}
run merge_maps > "$work/all.txt"
PY=$PYTHON312 run move "$work/all.txt" .
find kinematics planner controllers benchmarks pulsepath tests -name __pycache__ -prune -exec rm -rf {} +
find kinematics planner controllers benchmarks pulsepath -type d -empty -delete
tidy
run seam_figures && tidy && run seam_model && tidy && run seam_small && tidy
PY=$PYTHON312 run rename tests/house/names.txt .
tidy
for _ in 1 2 3; do run wrap; ruff format -q .; done
run final
git add -A
run import_all
rm -rf "$work"
