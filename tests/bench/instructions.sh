#!/usr/bin/env bash
# Instructions per step of robots with drives, an instance each and all on one, against the same robots without plugins,
# by valgrind. Argument: folder of the benchmark programs (build/release/tests). Loading is taken out by the difference
# of two runs.
set -euo pipefail
steps="${1:-build/release/tests}/steps"
count() {  # ours|shared|native INTEGRATOR static|lugre ROBOTS STEPS
  valgrind --tool=callgrind --callgrind-out-file=/dev/null "$steps" "$@" 2>&1 | awk '/Collected/ {print $NF}'
}
per_step() {  # ours|shared|native INTEGRATOR static|lugre ROBOTS
  local few many n=$((400 / $4))
  few=$(count "$@" $n)
  many=$(count "$@" $((2 * n)))
  echo $(((many - few) / n))
}
ratio() { awk "BEGIN {printf \"%.3f\", $1 / $2}"; }
printf '%-10s %-8s %6s  %9s %9s %6s %9s %6s\n' integrator friction robots native ours ratio shared ratio
for case in "Euler static 1" "implicit static 1" "RK4 static 1" "Euler lugre 1" "implicit lugre 1" "Euler static 10"; do
  native=$(per_step native $case)
  ours=$(per_step ours $case)
  shared=$(per_step shared $case)
  printf '%-10s %-8s %6s  %9d %9d %6s %9d %6s\n' $case "$native" "$ours" "$(ratio "$ours" "$native")" "$shared" \
    "$(ratio "$shared" "$native")"
done
