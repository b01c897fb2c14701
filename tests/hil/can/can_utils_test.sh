#!/usr/bin/env bash
# can_utils_test.sh SOCKETCAN_TEST, by tests/can_vm/run.sh: what cansend and cangen send comes to us, what we send back
# comes
# to candump, and candump writes both alike.
set -euo pipefail
program=$1 work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null; rm -r "$work"' EXIT
frames=(000# 123#DEADBEEF 7FE#0102030405060708 00000123#11 1FFFFFFF#2233445566778899 123#R 123#R8
  123##0 123##0AA 123##1AABB 123##2CC 1FFFFFFF##3"$(printf '%02X' {1..64})")
random=500

await() {   # await PATTERN COUNT: until candump wrote COUNT lines with it
  for _ in {1..400}; do
    [ "$(grep -cE "$1" "$work/log" || true)" -ge "$2" ] && return
    sleep 0.05
  done
  echo "candump saw $(grep -cE "$1" "$work/log") of $2 frames $1; the last of $(wc -l <"$work/log"):" &&
    tail -n 3 "$work/log" && exit 1
}

candump -L -r 4000000 vcan0 >"$work/log" &
candump=$!
until [ -s "$work/log" ]; do
  kill -0 $candump
  cansend vcan0 7FD#
  sleep 0.05
done
CAN_ECHO_COUNT=$((${#frames[@]} + random)) "$program" --gtest_filter=CanUtils.Echo >"$work/echo" &
echo=$!
await ' 7FF#000000$' 1
for frame in "${frames[@]}"; do cansend vcan0 "$frame"; done
cangen vcan0 -n $random -g 0 -m   # all kinds, FD included; each of them random
wait $echo || { cat "$work/echo"; exit 1; }
await . $((1 + 2 * (${#frames[@]} + random)))

# Kernels differ in whether the flags of FD frames say that it is one (4): without.
sed -E '/ 7F(D#|F#000000)$/d; s/.* //; s/##4/##0/; s/##5/##1/; s/##6/##2/; s/##7/##3/' "$work/log" >"$work/frames"
for frame in "${frames[@]}"; do
  [ "$(grep -cFx -- "$frame" "$work/frames")" -ge 2 ] ||
    { echo "$frame did not come back the same:"; head -n 40 "$work/frames"; exit 1; }
done
odd=$(sort "$work/frames" | uniq -c | awk '$1 % 2')
[ -z "$odd" ] || { echo "not sent back as they came:"; echo "$odd"; exit 1; }
echo "$((${#frames[@]} + random)) frames of can-utils sent back"
