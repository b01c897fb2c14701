#!/usr/bin/env bash
# Installs what the project needs, builds it in Release and runs every test; before that the checks of format, and after
# it static analysis of what the last commit changed and the readers of foreign bytes under ASan and UBSan. Works from
# any folder, twice in a row.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
bash twin/install-packages.sh --tests
[ -d ../shared/data ] ||
  echo "NOTE: no ../shared/data beside the checkout: tests on real recordings will be SKIPPED." >&2

# Format. An export of the sources, which is no git checkout, has no list of files.
if git rev-parse --git-dir > /dev/null 2>&1; then
  git ls-files -z '*.cc' '*.hpp' '*.inc' | xargs -0 clang-format --dry-run -Werror
  git ls-files -z '*.py' | xargs -0 black --check -q -l 120 -S -C
else
  echo "NOTE: not a git checkout: format and static analysis are NOT checked." >&2
fi

options=(-G Ninja -DTRIBOTWIN_BUILD_TESTS=ON -DCMAKE_COMPILE_WARNING_AS_ERROR=ON -DTRIBOTWIN_UNITY_BUILD=ON)
cmake -S . -B build/release "${options[@]}" -DCMAKE_BUILD_TYPE=Release
cmake --build build/release

# Readers of files, frames and models from elsewhere, where a mistake would touch memory; all others at night, by
# tests/nightly.sh.
sanitized=(twin_io_telemetry_telemetry_test hil_can_can_test plugins_mujoco_mujoco_test fuzz_log_line)
# GCC 12 gives false warnings under sanitizers: no errors there.
cmake -S . -B build/sanitized "${options[@]}" -DCMAKE_BUILD_TYPE=Sanitized -DTRIBOTWIN_BUILD_REPORTS=OFF \
  -DCMAKE_COMPILE_WARNING_AS_ERROR=OFF \
  -DCMAKE_CXX_FLAGS="-g1 -fsanitize=address,undefined -fno-sanitize-recover=all" > /dev/null
cmake --build build/sanitized --target "${sanitized[@]}"
export LSAN_OPTIONS=suppressions=$root/tests/render/lsan.txt:print_suppressions=0
build/sanitized/tests/twin_io_telemetry_telemetry_test --gtest_brief=1
build/sanitized/tests/hil_can_can_test --gtest_brief=1
build/sanitized/tests/plugins_mujoco_mujoco_test --gtest_brief=1 --gtest_filter='Loader*:Drive*'
build/sanitized/tests/fuzz_log_line 100000 1

# Static analysis of the first ten changed sources, which the time limit allows. Its compile commands are of a build
# without unity and without precompiled headers, which clang cannot read.
changed() {
  git diff --name-only --diff-filter=d HEAD^ -- 'plugins/*.cc' 'twin/*.cc' 'hil/*.cc' 'render/*.cc' |
    while read -r source; do
      # Not those of another engine version, which are not compiled here.
      if grep -qF "/$source\"" build/analysis/compile_commands.json; then echo "$source"; fi
    done | awk 'NR <= 10'
}
if git rev-parse -q --verify HEAD^ > /dev/null 2>&1; then
  cmake -S . -B build/analysis -G Ninja -DTRIBOTWIN_BUILD_TESTS=OFF -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON > /dev/null
  changed | xargs -r -P "$(nproc)" -n 1 clang-tidy --quiet -p build/analysis
fi

# All packages are here: a test that would be skipped without one fails. One test more than there are cores, because
# those of drives and masters mostly wait.
export TRIBOTWIN_EVERY_TEST=1
exec ctest --test-dir build/release --output-on-failure --parallel $(($(nproc) + 1)) --no-tests=error
