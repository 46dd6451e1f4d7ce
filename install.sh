#!/bin/sh
# Make the environment .venv in this folder, if it is not there, and install into it what pip is to install:
#     sh install.sh ".[camera]"
# On Debian and Ubuntu, python3-venv comes by apt-get if it is missing; this needs root or sudo.
set -eu
cd "$(dirname "$0")"
as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}
if ! python3 -c 'import ensurepip' 2>/dev/null && command -v apt-get >/dev/null; then
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y python3-venv
fi
python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "install.sh: Python 3.11 or newer is needed, and python3 is $(python3 --version)" >&2
    exit 1
}
python3 -m venv .venv
.venv/bin/pip install "$@"
