#!/usr/bin/env bash
# run.sh [-w DIR]... [-t SECONDS] [--] CMD ARG...: runs CMD where vcan0 and vcan1 are up and nobody else uses them. See
# README.md.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
say() { echo "can_vm: $*" >&2; }

writable=() seconds=300
while getopts w:t: option; do
  case $option in
    w) writable+=("$(realpath -e -- "$OPTARG" 2>/dev/null)") || { say "-w $OPTARG: no such folder"; exit 125; } ;;
    t) seconds=$OPTARG ;;
    *) say "usage: run.sh [-w DIR]... [-t SECONDS] [--] CMD ARG..."; exit 125 ;;
  esac
done
shift $((OPTIND - 1))
[ $# -gt 0 ] || { say "usage: run.sh [-w DIR]... [-t SECONDS] [--] CMD ARG..."; exit 125; }

# A kernel that has CAN needs no VM: a network namespace of our own keeps clear of the buses of this machine.
namespace=(unshare --net)
[ $EUID = 0 ] || namespace+=(--map-root-user)
if "${namespace[@]}" bash "$here/buses.sh" 2>/dev/null; then
  code=0
  export CAN_VM=namespace
  timeout -k 3 "$seconds" "${namespace[@]}" bash -c 'bash "$0" && exec "$@"' "$here/buses.sh" "$@" </dev/null || code=$?
  [ $code != 124 ] || say "time limit of $seconds s"
  exit $code
fi

missing=()
need() { command -v "$1" >/dev/null || [ -e "$1" ] || missing+=("$2"); }   # need PROGRAM PACKAGE
need linux.uml user-mode-linux; need gcc gcc; need /usr/include/stdio.h libc6-dev; need modprobe kmod
need ip iproute2; need cansend can-utils; need busybox busybox-static; need taskset util-linux
if [ ${#missing[@]} -gt 0 ]; then
  say "this kernel has no CAN, and the VM that has lacks packages:" \
    "apt-get install -y --no-install-recommends ${missing[*]}"
  exit 125
fi

job=$(mktemp -d "${TMPDIR:-/tmp}/can_vm.XXXXXX")   # seen by the guest under the same path
pid=
trap '[ -z "$pid" ] || kill "$pid" 2>/dev/null || true; rm -rf "$job"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
cp "$here"/{boot,guest,buses}.sh "$job"
chmod +x "$job/boot.sh"
gcc -O2 -shared -fPIC -o "$job/xstate_shim.so" "$here/xstate_shim.c"
printf '%s\n' "$job" "${writable[@]}" >"$job/writable"
export CAN_VM=vm
{
  export -p | grep -vE '^declare -x (PWD|OLDPWD|SHLVL|TMPDIR|HOME|TERM|LD_PRELOAD)(=|$)'
  printf 'cd %q || exit 125\nexec' "$PWD"
  printf ' %q' "$@"
} >"$job/command"

memory_mb=1024   # a sparse file: in /dev/shm if it fits, because /tmp may be a disk
files=/dev/shm
{ [ -w $files ] && [ "$(df -Pm $files | awk 'NR == 2 { print $4 }')" -gt $((memory_mb + 256)) ]; } ||
  files=${TMPDIR:-/tmp}
cpu=$(taskset -pc $$ | sed 's/.*[ ,-]//')   # the VM's kernel and its processes on one core: half the latency
LD_PRELOAD=$job/xstate_shim.so TMPDIR=$files taskset -c "$cpu" timeout -k 3 "$seconds" \
  linux.uml mem=${memory_mb}M root=/dev/root rootfstype=hostfs rootflags=/ ro init="$job/boot.sh" JOB="$job" panic=1 \
  uml_dir="$job/" con=null con0=null,fd:5 con1=null,fd:3 con2=null,fd:4 \
  3>&1 4>&2 5>"$job/console.log" >"$job/boot.log" 2>&1 </dev/null &
pid=$!
code=0
wait $pid 2>/dev/null || code=$?
pid=
[ ! -s "$job/exit_code" ] || exit "$(cat "$job/exit_code")"
if [ $code = 124 ] || [ $code = 137 ]; then
  say "time limit of $seconds s"
  [ ! -e "$job/booted" ] || exit 124
fi
say "the VM $([ -e "$job/booted" ] && echo "died while the command ran" || echo "did not boot") (status $code)"
tail -n 20 "$job/boot.log" "$job/console.log" >&2
exit 125
