#!/bin/sh
# A Chromium for the page's tests: finds one, or installs one. Prints one line, and ends with 1
# where there is none and none can be had.
#
#     tools/provide_browser.sh [PYTHON]     PYTHON has playwright; default python3
set -u
PYTHON=${1:-python3}

for name in "${CARTSTIFF_CHROMIUM:-}" chromium chromium-browser google-chrome google-chrome-stable; do
  if [ -n "$name" ] && command -v "$name" >/dev/null 2>&1; then
    echo "browser: $(command -v "$name")"
    exit 0
  fi
done

# Playwright's own, downloaded earlier.
own=$("$PYTHON" -c 'from playwright.sync_api import sync_playwright as p
with p() as w: print(w.chromium.executable_path)' 2>/dev/null)
if [ -n "$own" ] && [ -x "$own" ]; then
  echo "browser: $own"
  exit 0
fi

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  echo "browser: installing chromium (apt-get)"
  export DEBIAN_FRONTEND=noninteractive
  if apt-get -qq update >/dev/null 2>&1 \
      && apt-get -qq -y install --no-install-recommends chromium >/dev/null 2>&1 \
      && command -v chromium >/dev/null 2>&1; then
    echo "browser: $(command -v chromium)"
    exit 0
  fi
fi

echo "browser: downloading Chromium (playwright)"
if "$PYTHON" -m playwright install chromium >/dev/null 2>&1; then
  echo "browser: playwright's own"
  exit 0
fi

echo "no Chromium found, and none could be installed: install the package chromium or Google" \
  "Chrome, or set CARTSTIFF_CHROMIUM to a browser's path" >&2
exit 1
