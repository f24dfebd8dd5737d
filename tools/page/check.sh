#!/usr/bin/env bash
# ESLint, the types and the unit tests of the page's JavaScript. Where there is no node, or its packages cannot be
# had, it says so and passes: a user of cartstiff needs neither.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

if ! command -v node > /dev/null || ! command -v npm > /dev/null; then
  echo "Skipped: the page's JavaScript is checked with node and npm, which are not installed here"
  exit 0
fi
# Installed once for each lock; nothing of a package runs while it is installed.
stamp=node_modules/.of-lock
if ! cmp -s package-lock.json "$stamp"; then
  if ! npm ci --ignore-scripts --no-audit --no-fund --silent; then
    echo "Skipped: npm could not install what checks the page's JavaScript"
    exit 0
  fi
  cp package-lock.json "$stamp"
fi
(cd ../.. && tools/page/node_modules/.bin/eslint -c tools/page/eslint.config.mjs src/cartstiff/shown/page/static)
node_modules/.bin/tsc -p tsconfig.json
node --test --test-reporter=dot scripts.test.mjs
