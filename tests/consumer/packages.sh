#!/usr/bin/env bash
# packages.sh BUILD SOURCE: makes the Debian packages of a build; lintian finds no error; the unpacked programs work
# without the source tree.
set -euo pipefail
build=$1 source=$(realpath "$2") work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cpack --config "$build/CPackConfig.cmake" -B "$work" > "$work/cpack.log" || { cat "$work/cpack.log"; exit 1; }
packages=("$work"/*.deb)
[[ ${#packages[@]} == [23] ]] ||
  { echo "expected tribotwin, libtribotwin-dev and perhaps tribotwin-mpi, found ${packages[*]}"; exit 1; }
user=()
[ "$(id -u)" -eq 0 ] && user=(--allow-root)
lintian "${user[@]}" --fail-on error "${packages[@]}"
for package in "${packages[@]}"; do
  dpkg-deb -x "$package" "$work/root"
done

# Hardened, as .github/SECURITY.md says.
for program in "$work"/root/usr/bin/*; do
  for wanted in "-dW FLAGS_1.*NOW.*PIE" "-lW GNU_RELRO" "-sW __stack_chk_fail" "-sW __[a-z]*_chk@"; do
    readelf ${wanted% *} "$program" | grep -- "${wanted#* }" > /dev/null ||
      { echo "$program: no ${wanted#* }"; exit 1; }
  done
done

# The same bytes wherever they are built: no program names the source tree.
if grep -lF "$source" "$work"/root/usr/bin/*; then exit 1; fi

cd "$work"
PATH=$PWD/root/usr/bin:$PATH
tribotwin run irb6620_hold --set duration_s=1 --quiet -o run
tribotwin run --list > scenarios
grep -q irb6620_warmup scenarios
tribotwin curve mjcf/irb6620.xml --joint joint2 --speeds 1:280:3
printf 'model: irb6620.xml\nduration_s: 1\ncontrol: {type: torque}\n' > mine.yaml
tribotwin run mine.yaml --quiet -o mine
tribotwin-hil budget irb6620_hold
if [ -x root/usr/bin/tribotwin-report ]; then
  tribotwin-report pose mjcf/irb6620.xml -o pose.png
  tribotwin-report run
  [ -s pose.png ] && [ -s run/report.html ]
fi
if ls "$work"/tribotwin-mpi_*.deb > /dev/null 2>&1; then   # found where it is installed
  export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_plm=isolated OMPI_MCA_btl=self,vader
  mpirun --oversubscribe -n 2 tribotwin lab rh380n_friction --quiet -o lab
  [ -s lab/curves.csv ]
fi
[ -s run/telemetry.h5 ] && [ -s mine/summary.json ]
if grep "$source" mine/scenario.yaml; then exit 1; fi
