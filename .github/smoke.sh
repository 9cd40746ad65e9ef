#!/usr/bin/env bash
# The command from a log to code, in a folder that is removed: bash .github/smoke.sh target/debug/fleetfoot
set -euo pipefail
command="$(cd "$(dirname "$1")" && pwd)/$(basename "$1")"
place=$(mktemp -d)
trap 'cd / && rm -rf "$place"' EXIT
cd "$place"
"$command" --version
"$command" generate diffdrive --seconds 5 --runs 2 -o runs
"$command" info runs
"$command" fit pwa -c runs/robot.toml runs --partition average -o model.json
"$command" rollout model.json runs --horizon 20
"$command" export model.json --to c -o src
test -s src/model.c
echo "the command works"
