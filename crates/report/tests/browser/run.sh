#!/usr/bin/env bash
# Opens reports of synthetic runs in headless Chromium with the network off.
#   tests/browser/run.sh [OUTPUT]     screenshots go to OUTPUT (default: <target>/browser)
# With REPORTS="a.html b.html" those pages are opened instead. Installs Chromium (apt) and
# playwright-core (npm) if they are not there.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
out=${1:-$target/browser}
mkdir -p "$out"

chromium=${CHROMIUM:-$(command -v chromium || command -v chromium-browser || true)}
if [ -z "$chromium" ]; then
  apt-get update -qq
  apt-get install -y -qq chromium >/dev/null
  chromium=$(command -v chromium)
fi

modules=${PLAYWRIGHT_DIR:-$target/playwright}
if [ ! -d "$modules/node_modules/playwright-core" ]; then
  mkdir -p "$modules"
  PLAYWRIGHT_SKIP_BROWSER_DOWNLOAD=1 npm install --prefix "$modules" --no-save --silent playwright-core@1
fi

if [ -z "${REPORTS:-}" ]; then
  (cd "$root" && cargo test -q -p stridemap-report --test report_page >/dev/null)
  pages="$target/tmp/pages"
  REPORTS="$pages/run.html $pages/fall.html $pages/killed.html $pages/one.html $pages/runs.html"
fi

NODE_PATH="$modules/node_modules" CHROMIUM="$chromium" OUT="$out" node "$here/report.cjs" $REPORTS
