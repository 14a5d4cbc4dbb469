#!/bin/sh
# Makes sure a Chromium is there for the browser tests; says the one line that installs it if not.
for name in chromium chromium-browser google-chrome; do
    command -v "$name" >/dev/null 2>&1 && exit 0
done
if command -v apt-get >/dev/null 2>&1; then
    run=""
    [ "$(id -u)" = 0 ] || run="sudo -n"
    $run apt-get update -qq >/dev/null 2>&1
    DEBIAN_FRONTEND=noninteractive $run apt-get install -y -qq --no-install-recommends chromium \
        >/dev/null 2>&1 && exit 0
fi
.venv/bin/python -m playwright install chromium >/dev/null 2>&1 && exit 0
echo "No Chromium found: the browser tests will fail. Install it with: sudo apt-get install chromium" >&2
exit 0
