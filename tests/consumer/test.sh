#!/usr/bin/env bash
# Installs the build into a fresh folder; checks what is there; builds and runs a consumer of it, a consumer of one law
# on
# a machine without the packages that a law does not need, and the installed program.
set -euo pipefail
build=$1 source=$2 work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/prefix" > /dev/null
headers=$work/prefix/include/tribotwin

for internal in twin/numerics/least_squares twin/identification/linearised twin/identification/curves/moments_kernel \
  twin/identification/dynamic_friction/prediction_error twin/io/command_line/command_line; do
  [ -e "$source/$internal.hpp" ] ||
    { echo "$internal.hpp: is no longer in the tree; remove it from this test"; exit 1; }
  [ ! -e "$headers/$internal.hpp" ] || { echo "$internal.hpp: is internal, but installed"; exit 1; }
done
# What is installed includes only what is installed.
(cd "$work/prefix/include" && grep -rhoE '#include <tribotwin/[^>]+>' tribotwin) | sort -u | sed 's/.*<\(.*\)>/\1/' |
  while read -r header; do
    [ -e "$work/prefix/include/$header" ] ||
      { echo "$header: is included by an installed header, but not installed"; exit 1; }
  done

configure() { cmake -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/prefix" "$@" > /dev/null; }
configure -S "$source/tests/consumer" -B "$work/build" "${@:3}"
cmake --build "$work/build"
"$work/build/consumer" "$work/prefix/share/tribotwin/twin/scenarios/irb6620_warmup.yaml"

hidden=(Boost CLI11 Ceres HDF5 Threads mujoco nlohmann_json pugixml yaml-cpp)
configure -S "$source/tests/consumer/one_law" -B "$work/one_law" \
  $(printf -- '-DCMAKE_DISABLE_FIND_PACKAGE_%s=ON ' "${hidden[@]}")
cmake --build "$work/one_law"
"$work/one_law/one_law"

cp "$work/prefix/share/tribotwin/mjcf/irb6620.xml" "$work/prefix/share/tribotwin/mjcf/scene.xml" "$work/"
"$work/prefix/bin/tribotwin" curve "$work/irb6620.xml" --joint joint2 --speeds 1:280:3
