#!/usr/bin/env bash
# Opens the pages of real runs in headless Chromium with the network off.
#   tests/browser/run.sh STRIDEMAP [OUTPUT]     screenshots go to OUTPUT (default: <target>/browser)
# The runs are made by that binary: stepping (with pushes), walking, a run with a fall, one killed half-way, one with
# one stride, and three seeds side by side. With REPORTS="a.html b.html" those pages are opened instead.
# Installs Chromium (apt) and playwright-core (npm) where they are missing; fails if that is not possible.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
stridemap=$(realpath "${1:?usage: run.sh STRIDEMAP [OUTPUT]}")
out=${2:-$target/browser}
fail() { printf 'browser test: %s\n' "$*" >&2; exit 1; }
[ -x "$stridemap" ] || fail "$stridemap is not a program; build it first"
rm -rf "$out"
mkdir -p "$out"

find_chromium() { command -v chromium || command -v chromium-browser || command -v google-chrome || true; }
chromium=${CHROMIUM:-$(find_chromium)}
if [ -z "$chromium" ]; then
  export DEBIAN_FRONTEND=noninteractive
  sudo=; [ "$(id -u)" = 0 ] || sudo="sudo -n"
  $sudo apt-get update -qq
  $sudo apt-get install -y -qq --no-install-recommends chromium nodejs npm >"$out/apt.log" 2>&1 || { tail -20 "$out/apt.log" >&2; fail "Chromium cannot be installed"; }
  chromium=$(find_chromium)
fi
[ -n "$chromium" ] || fail "there is no Chromium"
command -v node >/dev/null || fail "there is no node"

modules=${PLAYWRIGHT_DIR:-$target/playwright}
if [ ! -d "$modules/node_modules/playwright-core" ]; then
  mkdir -p "$modules"
  PLAYWRIGHT_SKIP_BROWSER_DOWNLOAD=1 npm install --prefix "$modules" --no-save --silent --no-audit --no-fund playwright-core@1 \
    || fail "playwright-core cannot be installed"
fi

if [ -z "${REPORTS:-}" ]; then
  runs=$out/runs
  mkdir -p "$runs"
  say() { "$stridemap" "$@" >>"$out/runs.log" 2>&1 || { tail -20 "$out/runs.log" >&2; fail "stridemap $* failed"; }; }
  say learn stepping --out "$runs/stepping"
  say push "$runs/stepping"
  say push "$runs/stepping" --nominal
  say report "$runs/stepping"
  say learn walking --seed 3 --out "$runs/walking"
  # A robot that falls while it learns: actions that the narrow, slippery feet do not carry.
  say learn stepping --out "$runs/fall" --set robot.friction=0.3 --set 'action.0.explore.center=[4.5, 5.0]' \
    --set action.0.explore.std=0.3 --set failure.psi_roll_below_deg=1.5 --set algorithm.iterations=1 \
    --set record.strides=20 --set record.iteration_strides=5
  grep -q ',fell,' "$runs/fall/transitions.csv" || fail "the run that should hold a fall holds none"
  # Killed without a chance to say good-bye, in the second iteration.
  "$stridemap" learn stepping --out "$runs/killed" >>"$out/runs.log" 2>&1 & pid=$!
  for _ in $(seq 600); do
    [ -f "$runs/killed/transitions.csv" ] && [ "$(wc -l <"$runs/killed/transitions.csv")" -gt 40 ] && break
    sleep 0.02
  done
  kill -9 "$pid"
  wait "$pid" 2>/dev/null || true
  [ ! -f "$runs/killed/summary.json" ] || fail "the run that should be killed reached its end"
  say report "$runs/killed"
  # One stride, the least that a page can show: a task that plans so few is refused, so the others are cut off.
  say collect stepping --out "$runs/one" --set 'collect.strides=[3]'
  sed -i '3,$d' "$runs/one/transitions.csv"
  say report "$runs/one"
  say learn stepping --seeds 3 --out "$runs/seeds"
  say report "$runs/stepping" "$runs/killed" --out "$runs/beside.html"
  REPORTS="$runs/stepping/report.html $runs/walking/report.html $runs/fall/report.html $runs/killed/report.html $runs/one/report.html"
  REPORTS="$REPORTS $runs/seeds/stepping-seeds-1-to-3/report.html $runs/beside.html"
fi

NODE_PATH="$modules/node_modules" CHROMIUM="$chromium" OUT="$out" node "$here/report.cjs" $REPORTS
