#!/usr/bin/env bash
# Dependencies point one way: plugins <- twin <- {hil, render}; the laws know no engine; hil and render not each other.
set -uo pipefail
cd "$1"
status=0
forbid() {   # forbid FOLDER PATTERN WHY
  [ -d "$1" ] || return 0
  if hits=$(grep -rnE "#include *[<\"]$2" --include='*.hpp' --include='*.cc' "$1"); then
    printf '%s: %s\n%s\n' "$1" "$3" "$hits"
    status=1
  fi
}
forbid plugins 'tribotwin/(twin|hil|render)/' 'knows of twins, buses or pictures'
forbid plugins/friction '(mujoco|tribotwin/plugins/(thermal|drive|mujoco)/)' 'a law is values in, value out'
forbid plugins/thermal '(mujoco|Eigen|tribotwin/plugins/(friction|drive|mujoco)/)' 'a law is values in, value out'
forbid plugins/drive '(mujoco|tribotwin/plugins/mujoco/)' 'a drive knows no engine'
forbid twin 'tribotwin/(hil|render)/' 'a twin knows no bus and no picture'
forbid hil 'tribotwin/render/' 'the bench knows no pictures'
forbid render 'tribotwin/hil/' 'reports know no bus'
for folder in $(find plugins twin hil render -type d \( -name utils -o -name common -o -name misc \) 2>/dev/null); do
  echo "$folder: say what is in it"
  status=1
done
exit $status
