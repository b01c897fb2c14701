#!/usr/bin/env bash
# Installs the build into a fresh folder, builds a consumer against it, runs both the consumer and the installed program.
set -euo pipefail
build=$1 source=$2 work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/prefix" > /dev/null
cmake -S "$source/tests/consumer" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$work/prefix" "${@:3}" > /dev/null
cmake --build "$work/build"
"$work/build/consumer" "$work/prefix/share/tribotwin/twin/scenarios/irb6620_warmup.yaml"
cp "$work/prefix/share/tribotwin/mjcf/irb6620.xml" "$work/prefix/share/tribotwin/mjcf/scene.xml" "$work/"
"$work/prefix/bin/tribotwin" curve "$work/irb6620.xml" --joint joint2 --speeds 1:280:3
