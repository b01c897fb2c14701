#!/usr/bin/env bash
# What the bench costs on the bus, in turns with a bare program: tests/can_vm/run.sh -t 900 tests/bench/bus.sh BUILD
# [MINUTES].
# Round trip SYNC -> TPDO of six drives against a frame that can_echo answers; cycles per second in lockstep; then
# MINUTES at
# 500 Hz without a lost PDO.
set -euo pipefail
build=$1 minutes=${2:-0} source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
# The virtual machine has one processor: like a real controller, the asking side runs as soon as its answer is there.
trip="chrt -f 10 $build/tests/can_round_trip"
"$build/bin/tribotwin-hil" drive "$source/twin/scenarios/irb6620_hold.yaml" --can vcan0 --quiet &
drives=$!
trap 'kill $drives' EXIT
sleep 1
cansend vcan0 000#0100
sleep 0.2
$trip vcan0 080 381 100 2000 > /dev/null
ratios=()
for i in 1 2 3 4 5; do
  "$build/tests/can_echo" vcan1 080 381 1000 &
  echo=$!
  sleep 0.1
  read -r bare bare99 _ missing <<< "$($trip vcan1 080 381 1000 2000)"
  wait $echo
  read -r twin twin99 _ lost <<< "$($trip vcan0 080 381 1000 2000)"
  ratios+=("$(awk "BEGIN {printf \"%.2f\", $twin / $bare}")")
  echo "round trip, median (99 %) [us]: bare program $bare ($bare99),"\
" six drives $twin ($twin99); unanswered $missing, $lost; ratio ${ratios[-1]}"
done
echo "median ratio: $(printf '%s\n' "${ratios[@]}" | sort -n | sed -n 3p)"
read -r _ _ rate lost <<< "$($trip vcan0 080 386 3000 0)"
echo "lockstep: $rate cycles per second (SYNC to the sixth drive's TPDO), unanswered $lost"
if [ "$minutes" -gt 0 ]; then
  read -r _ _ rate lost <<< "$($trip vcan0 080 386 $((minutes * 30000)) 2000)"
  echo "$minutes min at 500 Hz: $rate cycles per second, lost $lost"
fi
