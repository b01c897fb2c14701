#!/usr/bin/env bash
# Instructions per step of robots with drives against the same robots without plugins, by valgrind. Argument: folder of
# the benchmark programs (build/release/tests). Loading is taken out by the difference of two runs.
set -euo pipefail
steps="${1:-build/release/tests}/steps"
count() {  # ours|native INTEGRATOR static|lugre ROBOTS STEPS
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$steps" "$@" 2>&1 | awk '/Collected/ {print $NF}'
}
per_step() {  # ours|native INTEGRATOR static|lugre ROBOTS
  local few many n=$((400 / $4))
  few=$(count "$@" $n)
  many=$(count "$@" $((2 * n)))
  echo $(((many - few) / n))
}
printf '%-12s %-7s %6s  %10s %10s  %s\n' integrator friction robots native ours ratio
for case in "Euler static 1" "implicit static 1" "RK4 static 1" "Euler lugre 1" "implicit lugre 1" "Euler static 10"; do
  native=$(per_step native $case)
  ours=$(per_step ours $case)
  printf '%-12s %-7s %6s  %10d %10d  %s\n' $case "$native" "$ours" "$(awk "BEGIN {printf \"%.3f\", $ours / $native}")"
done
