#!/usr/bin/env bash
# fuzz.sh [-s SECONDS] [-t TIMEOUT] [-b BUILD] [-c CORPUS] [READER..]: libFuzzer on each reader, and on each program of
# a protocol (fuzz_sdo, ..), for so many seconds (20), one after another; default: all. Inputs that reach something new
# are merged into CORPUS/READER (tests/fuzz/corpus), those of protocols into BUILD/fuzz-corpus, the smallest first; what
# crashes or takes more than TIMEOUT (1 s; more on a busy machine) or 512 MiB lies in BUILD/fuzz-found and makes the
# exit code 1.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
seconds=20 timeout=1 build=$root/build/fuzz corpus=$root/tests/fuzz/corpus
while getopts s:t:b:c: option; do
  case $option in
    s) seconds=$OPTARG ;;
    t) timeout=$OPTARG ;;
    b) build=$OPTARG ;;
    c) corpus=$OPTARG ;;
    *) sed -n '2,6s/^# //p' "$0" >&2; exit 2 ;;
  esac
done
shift $((OPTIND - 1))
declare -A program_of
for program in "$build"/tests/fuzz_{formats,readers,pages}; do
  [ ! -x "$program" ] || for reader in $("$program"); do program_of[$reader]=$program; done
done
for name in fuzz_{sdo,sdo_block,frames,lss,mirror,profile_position,log_line}; do
  [ ! -x "$build/tests/$name" ] || program_of[$name]=$build/tests/$name
done
[ ${#program_of[@]} -gt 0 ] || { echo "$build: cmake --preset fuzz && cmake --build --preset fuzz" >&2; exit 2; }
if [ $# -gt 0 ]; then readers=("$@"); else mapfile -t readers < <(printf '%s\n' "${!program_of[@]}" | sort); fi

# What a reader begins with: its own corpus, or files that ship.
seeds_of() {
  case $1 in
    scenario | plan | campaign | days | study) echo "$root/twin/scenarios" ;;
    mjcf) echo "$root/mjcf" ;;
    urdf) echo "$root/tests/twin/gears" ;;
    killed) echo "$root/tests/fuzz/corpus/telemetry" ;;
    friction) echo "$root/tests/fuzz/corpus/dynamics" ;;
    *) echo "$root/tests/fuzz/corpus/$1" ;;
  esac
}

found=$build/fuzz-found
mkdir -p "$found"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Leaks are those of HDF5 and the engine; a child that reads a damaged file first ends as it must (twin/io/telemetry).
limits=(-rss_limit_mb=512 -malloc_limit_mb=4096 -timeout="$timeout" -detect_leaks=0 -max_len=65536 -print_final_stats=1)
failed=0
printf '%-22s %12s %10s %10s  %s\n' reader executions features corpus found
for reader in "${readers[@]}"; do
  program=("${program_of[$reader]:?no such reader}") kept=$corpus/$reader seeds=$(seeds_of "$reader")
  case $reader in
    fuzz_*) kept=$build/fuzz-corpus/$reader seeds=$kept ;;
    *) program+=("$reader") ;;
  esac
  fresh=$work/$reader log=$work/$reader.log
  mkdir -p "$fresh" "$kept"
  outcome=nothing
  "${program[@]}" "${limits[@]}" -max_total_time="$seconds" -artifact_prefix="$found/$reader-" \
    "$fresh" "$kept" "$seeds" > "$log" 2>&1 ||
    { outcome="see $found/$reader.log"; cp "$log" "$found/$reader.log"; failed=1; }
  "${program[@]}" "${limits[@]}" -merge=1 -artifact_prefix="$work/" "$kept" "$fresh" \
    > "$work/merge.log" 2>&1 || true
  printf '%-22s %12s %10s %10s  %s\n' "$reader" "$(awk '/number_of_executed_units/ {print $2}' "$log")" \
    "$(grep -o 'ft: [0-9]*' "$log" | tail -1 | cut -c5-)" "$(find "$kept" -type f | wc -l)" "$outcome"
  rmdir --ignore-fail-on-non-empty "$kept"
done
exit $failed
