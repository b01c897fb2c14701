#!/usr/bin/env bash
# Installs what the project needs, builds it in Release and runs every test. Works from any folder, twice in a row.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bash "$root/twin/install-packages.sh" --tests
[ -d "$root/../shared/data" ] || echo "NOTE: no ../shared/data beside the checkout: tests on real recordings will be SKIPPED." >&2
cmake -S "$root" -B "$root/build/release" -G Ninja -DCMAKE_BUILD_TYPE=Release -DTRIBOTWIN_BUILD_TESTS=ON
cmake --build "$root/build/release"
exec ctest --test-dir "$root/build/release" --output-on-failure --parallel "$(nproc)" --no-tests=error
