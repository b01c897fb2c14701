#!/usr/bin/env bash
# nightly.sh [PART..]: what takes hours, one part after another, and a table at the end; exit code 1 if a part failed.
# Parts, all of them without a name:
#   tests      every test in its long form, in Release
#   asan       the tests of the preset asan (AddressSanitizer, UBSan)
#   tsan       the tests of the preset tsan (ThreadSanitizer)
#   fuzz       libFuzzer on every reader, FUZZ_SECONDS each (600)
#   mutation   MISTAKES (22) in each of FOLDERS, 308, of which the tests must find 90 %
#   coverage   lines and branches that the tests reach, by folder
#   soak       six drives at 1 kHz for MINUTES (60)
# Shorter: TARGETS='plugins_friction_friction_test ..' builds those alone, TESTS=REGEX runs those alone. What a part
# printed lies in build/nightly. Install before: bash twin/install-packages.sh --tests
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
parts=(tests asan tsan fuzz mutation coverage soak)
folders=(plugins/{friction,thermal,drive,mujoco} hil/canopen+hil/cia402 hil/canopen/setup+hil/canopen
  twin/identification/{curves,dynamic_friction,resampling,rigid_body,thermal,verdict} twin/diagnosis{,/fleet})
[ -z "${FOLDERS:-}" ] || read -ra folders <<< "$FOLDERS"
read -ra targets <<< "${TARGETS:+--target $TARGETS}"
only=(${TESTS:+-R "$TESTS"})

build() { cmake --preset "$1" && cmake --build --preset "$1" "${targets[@]}"; }
tests() { build release && TRIBOTWIN_NIGHTLY=1 ctest --preset release "${only[@]}"; }
asan() { build asan && ctest --preset asan "${only[@]}"; }
tsan() { build tsan && ctest --preset tsan "${only[@]}"; }
fuzz() { build fuzz && bash tests/fuzz/fuzz.sh -s "${FUZZ_SECONDS:-600}"; }
mutation() {
  cmake --preset release && /usr/bin/python3 tests/mutate.py --count "${MISTAKES:-22}" --least 0.9 "${folders[@]}"
}
coverage() {
  local passed=0
  build coverage || return
  find build/coverage -name '*.gcda' -delete
  ctest --preset coverage "${only[@]}" || passed=1
  /usr/bin/python3 tests/coverage.py build/coverage && return $passed
}
soak() {
  local first=(chrt --rr 1)
  "${first[@]}" true 2> /dev/null || first=()
  cmake --preset release && cmake --build --preset release --target tribotwin-hil socketcand_round_trip &&
    "${first[@]}" /usr/bin/python3 tests/soak.py build/release "${MINUTES:-60}"
}

for part in "$@"; do
  [[ " ${parts[*]} " == *" $part "* ]] || { sed -n '2,12s/^# //p' "$0" >&2; exit 2; }
done
[ $# -eq 0 ] || parts=("$@")
mkdir -p build/nightly
failed=0
for part in "${parts[@]}"; do
  begun=$SECONDS outcome=passed
  "$part" > "build/nightly/$part.log" 2>&1 || { outcome=FAILED; failed=1; }
  rows+=("$(printf '%-9s %-7s %6d s  build/nightly/%s.log' "$part" $outcome $((SECONDS - begun)) "$part")")
  printf '%s\n' "${rows[-1]}" >&2
done
printf '%s\n' "" "${rows[@]}"
exit $failed
