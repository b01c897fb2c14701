#!/usr/bin/env bash
# What the bench costs over socketcand, in turns with a bare echo server on the same transport:
# bash tests/bench/socketcand.sh BUILD [MINUTES]. Round trip SYNC -> TPDO of the first of six drives against an echo;
# then MINUTES of SYNCs at 1 kHz, waiting for the sixth drive each time.
set -euo pipefail
build=$1 minutes=${2:-0} source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
trip=$build/tests/socketcand_round_trip
"$build/bin/tribotwin-hil" drive "$source/twin/scenarios/irb6620_hold.yaml" --quiet --cycle 1 \
  --can socketcand://127.0.0.1:29701/can0 &
drives=$!
"$build/tests/echo_server" socketcand://127.0.0.1:29702/can0 7000 > /dev/null &
echo=$!
trap 'kill $drives $echo 2> /dev/null || true' EXIT
sleep 1
"$trip" 29701 000#0100 181 1 0 > /dev/null   # NMT start
for i in {1..7}; do
  read -r bare bare99 _ missing <<< "$("$trip" 29702 080 081 1000 1000)"
  read -r twin twin99 _ lost <<< "$("$trip" 29701 080 381 1000 1000)"
  ratio=$(awk "BEGIN {printf \"%.2f %.2f\", $twin / $bare, $twin99 / $bare99}")
  echo "round trip, median (99 %) [us]: echo $bare ($bare99), six drives $twin ($twin99);" \
    "unanswered $missing, $lost; ratios $ratio"
  ratios+=("$ratio")
done
middle() { printf '%s\n' "${ratios[@]}" | cut -d ' ' -f "$1" | sort -n | sed -n 4p; }
echo "median of the ratios: $(middle 1), of the 99 %: $(middle 2)"
if [ "$minutes" -gt 0 ]; then
  read -r us us99 rate lost <<< "$("$trip" 29701 080 386 $((minutes * 60000)) 1000)"
  echo "$minutes min at 1 kHz: sixth drive after $us us ($us99 us); $rate cycles per second, incomplete $lost"
fi
