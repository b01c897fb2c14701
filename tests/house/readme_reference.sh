#!/usr/bin/env bash
# A README must end with what the tables in the code say. To renew: README_RENEW=1.
set -euo pipefail
program=$1 part=$2 readme=$3
mark='<!-- From here on generated from the tables in the code. -->'
if [ -n "${README_RENEW:-}" ]; then
  { sed "/$mark/q" "$readme"; echo; "$program" "$part"; } > "$readme.new" && mv "$readme.new" "$readme"
fi
diff <(sed "1,/$mark/d" "$readme" | tail -n +2) <("$program" "$part") ||
  { echo "$readme is behind the code; renew it with README_RENEW=1"; exit 1; }
